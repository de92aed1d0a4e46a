//! `host`: look after agents of swarms whose supervisors are on other machines.

use std::path::PathBuf;

use clap::Args;

use super::tell;
use crate::base::error::Result;
use crate::hosts::{Patience, serve};
use crate::supervisor::signals;

/// Run agents of swarms that `spawn --hosts` starts on another machine
///
/// It listens until it is ended, and is part of one swarm at a time. It runs no program but itself. Whoever has the key
/// can start agents here. The key does not encrypt: what agents observe can be read on the way. docs/hosts.md says more.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  vamaro-swarm host
  # for others, with a key that they have, too
  (umask 077; echo \"swarm:$(openssl rand -hex 32)\" > swarm.key)
  vamaro-swarm host --listen tcp/0.0.0.0:7447 --key swarm.key")]
pub struct Host {
    /// Where to listen. Beyond this machine that needs --key. With udp/HOST:PORT also for datagrams, by which
    /// `spawn --links network` sends what may be lost (builds with the feature `hosts-udp`)
    #[arg(long, value_name = "tcp/HOST:PORT", default_value = "tcp/127.0.0.1:7447")]
    listen: String,

    /// Let in only who has this key: a file with one line `name:secret` that nobody else can read
    #[arg(long, value_name = "FILE")]
    key: Option<PathBuf>,

    /// How long a supervisor may be silent before it is gone; the `patience` of its hosts.toml has to be the same
    #[arg(long, value_name = "TIME", default_value = "2s", value_parser = Patience::parse)]
    patience: Patience,
}

impl Host {
    /// Runs the command.
    pub fn run(self) -> Result<()> {
        signals::install()?;
        serve(&self.listen, self.key.as_deref(), self.patience, tell)
    }
}
