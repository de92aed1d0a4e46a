//! Real-time hygiene: a core, memory that stays, and a turn before all others. Asked for by each process for
//! itself; what the kernel refuses is said, and the swarm runs without it.

use std::fmt;

use rustix::io;
use rustix::mm::{MlockAllFlags, mlockall};
use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
use rustix::thread::{CpuSet, sched_getaffinity, sched_setaffinity};
use serde::{Deserialize, Serialize};
use thread_priority::{
    RealtimeThreadSchedulePolicy, ThreadPriority, ThreadSchedulePolicy, set_thread_priority_and_policy,
    thread_native_id,
};

/// What each process of a swarm asks the kernel for. The default is nothing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Scheduling {
    /// To run on one core only.
    pub pin: bool,
    /// To keep all its memory in RAM.
    pub lock_memory: bool,
    /// To run under SCHED_FIFO with this priority, 1 to 99: before all processes of the usual policy.
    pub fifo: Option<u8>,
}

impl Scheduling {
    /// Asks for it: core and policy are those of this thread, which keeps them, memory is that of the whole process.
    /// Threads and processes started later inherit core and policy, so a supervisor starts its agents first. It is
    /// process 0, and agent i is process i + 1.
    pub(crate) fn apply(&self, process: usize) -> Granted {
        Granted {
            pinned: self.pin && pin(process).is_ok(),
            memory_locked: self.lock_memory && lock_memory().is_ok(),
            fifo: self.fifo.is_some_and(|priority| go_first(priority).is_ok()),
        }
    }
}

/// What a process was granted of its [`Scheduling`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Granted {
    /// It runs on one core only.
    pub pinned: bool,
    /// All its memory stays in RAM.
    pub memory_locked: bool,
    /// It runs under SCHED_FIFO.
    pub fifo: bool,
}

impl Granted {
    /// One bit for each, as it travels.
    pub fn bits(self) -> u32 {
        u32::from(self.pinned) | u32::from(self.memory_locked) << 1 | u32::from(self.fifo) << 2
    }

    /// The same from its bits.
    pub fn from_bits(bits: u32) -> Granted {
        let is_set = |bit: u32| bits >> bit & 1 == 1;
        Granted { pinned: is_set(0), memory_locked: is_set(1), fifo: is_set(2) }
    }
}

/// What the processes of a swarm were granted: how many of them, where it was asked for.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Grants {
    /// The supervisor and its agents.
    pub processes: usize,
    /// Cores they were to share.
    pub cores: Option<usize>,
    /// Run on one core only.
    pub pinned: Option<usize>,
    /// Keep their memory in RAM.
    pub memory_locked: Option<usize>,
    /// The priority asked for.
    pub priority: Option<u8>,
    /// Run under SCHED_FIFO.
    pub fifo: Option<usize>,
}

impl Grants {
    /// Counts what processes that may share so many `cores` were granted; `None` if they asked for nothing.
    pub(crate) fn count(asked: &Scheduling, cores: usize, granted: &[Granted]) -> Option<Grants> {
        let count = |asked: bool, is_granted: fn(&Granted) -> bool| {
            asked.then(|| granted.iter().filter(|granted| is_granted(granted)).count())
        };
        (*asked != Scheduling::default()).then(|| Grants {
            processes: granted.len(),
            cores: asked.pin.then_some(cores.min(granted.len())),
            pinned: count(asked.pin, |granted| granted.pinned),
            memory_locked: count(asked.lock_memory, |granted| granted.memory_locked),
            priority: asked.fifo,
            fifo: count(asked.fifo.is_some(), |granted| granted.fifo),
        })
    }

    /// What was refused and how to be granted it; `None` if nothing was.
    pub fn refused(&self) -> Option<String> {
        let refused: Vec<String> =
            self.words().filter_map(|(words, refused)| refused.then_some(words)).collect();
        (!refused.is_empty()).then(|| refused.join("; "))
    }

    /// In words what was asked for, one thing after the other, and whether any process was refused it.
    fn words(&self) -> impl Iterator<Item = (String, bool)> {
        let Grants { processes, cores, pinned, memory_locked, priority, fifo } = *self;
        let cores = cores.map_or(String::new(), |n| format!(" to {n} core{}", if n == 1 { "" } else { "s" }));
        let priority = priority.unwrap_or_default();
        let asked = [
            pinned.map(|n| {
                let way_out = "sched_setaffinity, which a sandbox may forbid";
                (n, format!("pinned {n} of {processes} processes{cores}"), way_out.to_owned())
            }),
            memory_locked.map(|n| {
                let way_out = "CAP_IPC_LOCK, or `ulimit -l unlimited` where limits.conf or the service manager allows it";
                (n, format!("memory locked in {n} of {processes} processes"), way_out.to_owned())
            }),
            fifo.map(|n| {
                let way_out = format!("CAP_SYS_NICE, or `ulimit -r {priority}` where limits.conf or the service manager allows it");
                (n, format!("SCHED_FIFO {priority} in {n} of {processes} processes"), way_out)
            }),
        ];
        asked.into_iter().flatten().map(move |(granted, words, needed)| {
            if granted < processes {
                (format!("{words} (not permitted: it takes {needed})"), true)
            } else {
                (words, false)
            }
        })
    }
}

impl fmt::Display for Grants {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.words().map(|(words, _)| words).collect::<Vec<String>>().join("; "))
    }
}

/// The cores this thread may use, in their order; none if nobody can tell.
pub(crate) fn allowed_cores() -> Vec<usize> {
    let allowed = sched_getaffinity(None).unwrap_or_default();
    (0..CpuSet::MAX_CPU).filter(|core| allowed.is_set(*core)).collect()
}

/// The set of this core alone.
pub fn only(core: usize) -> CpuSet {
    let mut set = CpuSet::new();
    set.set(core);
    set
}

/// The core of a process among those that all may use.
///
/// By turns, so a core has at most one process more than another, and the agents, who do most of the work and do it
/// side by side, are as even as they can be. The supervisor works while they wait, and its core, the first, never
/// has more agents than another. It is the first because kernels tend to put the interrupts of devices there,
/// which then delay one process that all wait for anyway.
fn core_of(process: usize, cores: &[usize]) -> Option<usize> {
    cores.get(process.checked_rem(cores.len())?).copied()
}

fn pin(process: usize) -> io::Result<()> {
    let core = core_of(process, &allowed_cores()).ok_or(io::Errno::INVAL)?;
    sched_setaffinity(None, &only(core))
}

/// Locks what is mapped and what will be, and brings it all in at once: a page that is faulted in during a tick is
/// what this shall prevent. (So the stacks of a supervisor's threads are brought in as well.)
///
/// Only where no limit applies: later mappings count too, and the first above the limit would fail in the middle of a
/// run. So this lifts the limit first. If that is refused, it sets the limit to 0 for the moment: then the kernel locks
/// memory only for processes that no limit binds.
fn lock_memory() -> io::Result<()> {
    let limit = getrlimit(Resource::Memlock);
    let current = limit.maximum.map(|_| 0);
    setrlimit(Resource::Memlock, Rlimit { current, maximum: limit.maximum })?;
    let locked = mlockall(MlockAllFlags::CURRENT | MlockAllFlags::FUTURE);
    if locked.is_err() || current.is_some() {
        // Should the old limit be refused, what is locked stays locked.
        let _ = setrlimit(Resource::Memlock, limit);
    }
    locked
}

fn go_first(priority: u8) -> Result<(), String> {
    let priority = ThreadPriority::Crossplatform(priority.try_into()?);
    let policy = ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::Fifo);
    set_thread_priority_and_policy(thread_native_id(), priority, policy).map_err(|e| e.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cores_are_shared_out_evenly_and_the_supervisors_has_no_more_agents_than_others() {
        let assigned = |processes: usize, cores: &[usize]| {
            (0..processes).map(|process| core_of(process, cores).unwrap()).collect::<Vec<usize>>()
        };
        assert_eq!(assigned(5, &[0, 1]), [0, 1, 0, 1, 0]);
        assert_eq!(assigned(3, &[2, 5, 7, 8]), [2, 5, 7], "of those allowed, whatever their numbers");
        assert_eq!(core_of(0, &[]), None);
        for (agents, n) in (1..=64).flat_map(|agents| (1..=9).map(move |n| (agents, n))) {
            let cores: Vec<usize> = (0..n).collect();
            let assigned = assigned(agents + 1, &cores);
            let on = |core: &usize| assigned[1..].iter().filter(|assigned| *assigned == core).count();
            let (most, least) = (cores.iter().map(on).max(), cores.iter().map(on).min());
            assert!(most.unwrap() - least.unwrap() <= 1, "{agents} agents on {n} cores");
            assert_eq!(on(&assigned[0]), least.unwrap(), "{agents} agents on {n} cores");
        }
    }

    #[test]
    fn what_was_granted_comes_back_from_its_bits() {
        for bits in 0..8 {
            assert_eq!(Granted::from_bits(bits).bits(), bits);
        }
        let only_memory = Granted { memory_locked: true, ..Granted::default() };
        assert_eq!(Granted::from_bits(only_memory.bits()), only_memory);
    }

    #[test]
    fn a_process_that_asks_for_nothing_is_granted_nothing() {
        assert_eq!(Scheduling::default().apply(3), Granted::default());
        assert_eq!(Grants::count(&Scheduling::default(), 4, &[Granted::default(); 3]), None);
    }

    #[test]
    fn what_is_refused_is_said_with_a_way_out() {
        let asked = Scheduling { pin: true, lock_memory: true, fifo: Some(20) };
        let all = Granted { pinned: true, memory_locked: true, fifo: true };
        let grants = Grants::count(&asked, 2, &[all; 3]).unwrap();
        let text = "pinned 3 of 3 processes to 2 cores; memory locked in 3 of 3 processes; SCHED_FIFO 20 in 3 of 3 processes";
        assert_eq!((grants.to_string().as_str(), grants.refused()), (text, None));
        let without_fifo = Granted { fifo: false, ..all };
        let grants = Grants::count(&asked, 2, &[all, without_fifo, without_fifo]).unwrap();
        let refused = grants.refused().unwrap();
        assert!(refused.starts_with("SCHED_FIFO 20 in 1 of 3 processes (not permitted"), "{refused}");
        assert!(refused.contains("CAP_SYS_NICE") && refused.contains("ulimit -r 20"), "{refused}");
        assert!(grants.to_string().ends_with(&refused), "{grants}");
        let asked = Scheduling { lock_memory: true, ..Scheduling::default() };
        let grants = Grants::count(&asked, 2, &[Granted::default(); 3]).unwrap();
        let refused = grants.refused().unwrap();
        assert!(refused.contains("CAP_IPC_LOCK") && refused.contains("ulimit -l unlimited"), "{refused}");
        assert_eq!((grants.pinned, grants.memory_locked, grants.fifo), (None, Some(0), None));
    }
}
