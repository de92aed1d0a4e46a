//! What a swarm needs before it starts: weights that all agents can map, shared memory, open files.

use std::fs::Permissions;
use std::os::unix::fs::PermissionsExt;

use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};

use crate::agent::{AgentSettings, PolicySource};
use crate::base::error::{Error, Result};
use crate::base::tasks::Tasks;
use crate::bus::{
    Layout, SharedMemory, SwarmAddress, SwarmDirectory, open_files_needed, shared_memory_needed,
};
use crate::failed;
use crate::nn::Policy;

/// Puts weights into a file of the swarm's own, so that all agents map one copy of just these: those that are in
/// this process only, and those of a file that may have been replaced since it was opened, as a run in training
/// does. Those in the program itself are where they have to be, unless other programs are to read them too, or other
/// machines.
pub(super) fn share_weights(
    settings: &AgentSettings,
    policy: &Policy,
    directory: &SwarmDirectory,
    [for_others, for_elsewhere]: [bool; 2],
) -> Result<AgentSettings> {
    let mut settings = settings.clone();
    if settings.policy == PolicySource::Nobody {
        return Ok(settings);
    }
    let is_inside = settings.policy == PolicySource::Builtin && policy.is_shared(settings.worlds);
    if for_others || for_elsewhere || !is_inside {
        let path = directory.path().join("policy.safetensors");
        if for_others {
            policy.save(&path)?
        } else {
            policy.save_copy(&path, settings.worlds)?
        }
        std::fs::set_permissions(&path, Permissions::from_mode(0o600))
            .map_err(|e| Error::io("keep others from", &path, e))?;
        settings.policy = PolicySource::Copy(path);
    }
    Ok(settings)
}

/// Has the shared memory promised that a swarm may come to use: what runs out later shows up as SIGBUS.
pub(crate) fn reserve_shared_memory(
    directory: &SwarmDirectory,
    address: &SwarmAddress,
    layout: &Layout,
) -> Result<()> {
    let needed = shared_memory_needed(address, layout);
    directory.promise(needed)?.map_err(|memory| too_small(address, needed, &memory))
}

/// An error if a swarm at `address` would not start for want of shared memory; what it may come to use, in bytes.
pub(crate) fn check_shared_memory(
    address: &SwarmAddress,
    layout: &Layout,
    memory: &SharedMemory,
) -> Result<u64> {
    match shared_memory_needed(address, layout) {
        needed if needed <= memory.available() => Ok(needed),
        needed => Err(too_small(address, needed, memory)),
    }
}

fn too_small(address: &SwarmAddress, needed: u64, memory: &SharedMemory) -> Error {
    let mib = |bytes: u64| bytes as f64 / f64::from(1 << 20);
    let SwarmAddress { agents, worlds, .. } = address;
    failed!(
        "shared memory is too small: {agents} agents and {worlds} parallel worlds need up to {:.1} MiB, /dev/shm \
         has {:.1} MiB free of {:.1} MiB, of which {:.1} MiB are promised to other swarms; use fewer worlds \
         (--worlds, or update_every in training), see what `vamaro-swarm doctor` finds, or enlarge it (mount -o remount,size=.. /dev/shm)",
        mib(needed),
        mib(memory.free),
        mib(memory.total),
        mib(memory.promised)
    )
}

/// Raises the soft limit on open files as far as the swarm needs; its agents inherit it.
pub(crate) fn allow_open_files(agents: usize) -> Result<()> {
    let (needed, limit) = (open_files_needed(agents), getrlimit(Resource::Nofile));
    if limit.current.is_none_or(|current| current >= needed) {
        return Ok(());
    }
    let raised = Rlimit { current: Some(needed), maximum: limit.maximum };
    setrlimit(Resource::Nofile, raised).map_err(|_| {
        failed!("{agents} agents need {needed} open files a process; allow them with `ulimit -n {needed}`")
    })
}

/// An error if this user may not have the processes and threads of a swarm.
pub(crate) fn check_tasks(agents: usize) -> Result<()> {
    let needed = tasks_needed(agents);
    match Tasks::of_this_user() {
        Some(tasks) if tasks.free() < needed => Err(failed!(
            "{agents} agents need {needed} more processes and threads, but you have {} of the {} you may have; allow more \
             with `ulimit -u {}`",
            tasks.running,
            tasks.limit,
            tasks.running + needed
        )),
        _ => Ok(()),
    }
}

/// Processes and threads of a swarm besides its supervisor: each agent, a thread that listens to it, and one that watches
/// them all.
pub(crate) fn tasks_needed(agents: usize) -> u64 {
    2 * agents as u64 + 1
}
