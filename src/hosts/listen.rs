//! A program that listens for swarms, and is part of one at a time.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use crossbeam::channel::{RecvTimeoutError, bounded};

use super::echo::{Echo, Way};
use super::engine::{self, Engine};
use super::key::Key;
use super::orders::{Answer, Event, Identity, Invitation, Question, plain, say, understand};
use super::patience::Patience;
use super::plan::{check_address, is_within_this_machine};
use super::steward::Steward;
use crate::base::error::{Error, Result};
use crate::supervisor::{members_of, signals};
use crate::{failed, usage};

/// The longest this sleeps before it looks whether it was asked to stop.
const LONGEST_SLEEP: Duration = Duration::from_millis(100);

/// Somebody wants this host to do something that takes a while.
struct Request {
    question: engine::Question,
    task: Task,
}

enum Task {
    Join(Box<Invitation>),
    Echo(Echo),
}

/// Listens at an address until the program is asked to stop, for all that have the key. `tell` is told what happens.
pub(crate) fn serve(at: &str, key: Option<&Path>, patience: Patience, tell: impl Fn(&str)) -> Result<()> {
    check_address(at).map_err(|how| usage!("--listen {at}, {how}"))?;
    let key = key.map(Key::read).transpose()?;
    if key.is_none() && !is_within_this_machine(at) {
        return Err(usage!(
            "at {at} others could start agents here; give a key with --key FILE, or listen at tcp/127.0.0.1:7447"
        ));
    }
    let engine = Engine::listen(at, key.as_ref(), patience)?;
    let (is_busy, (ask, asked)) = (Arc::new(AtomicBool::new(false)), bounded(1));
    let busy = is_busy.clone();
    let _answering = engine.answer(move |question| {
        let asked = understand(&question.bytes());
        let answer = match asked {
            Err(e) => Answer::No(e.to_string()),
            Ok(Question::Who) => Answer::I(Identity::own(patience)),
            Ok(_) if busy.swap(true, Ordering::Relaxed) => {
                Answer::No("it looks after the agents of another swarm, or is being measured".to_owned())
            }
            // There is one at a time, and whoever listens has ended if there is no place.
            Ok(Question::Join(invitation)) => {
                return drop(ask.try_send(Request { question, task: Task::Join(invitation) }));
            }
            Ok(Question::Echo(echo)) => {
                return drop(ask.try_send(Request { question, task: Task::Echo(echo) }));
            }
        };
        question.answer(say(&answer));
    })?;
    tell(&format!("listening at {at}; Ctrl-C ends it"));
    loop {
        signals::check_stop()?;
        match asked.recv_timeout(LONGEST_SLEEP) {
            Ok(Request { question, task: Task::Join(invitation) }) => {
                look_after(&engine, question, &invitation, &is_busy, &tell)?;
            }
            Ok(Request { question, task: Task::Echo(echo) }) => {
                be_measured(&engine, at, question, &echo, &is_busy, &tell)?;
            }
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => return Err(failed!("the engine has ended")),
        }
    }
}

/// Joins a swarm, and is part of it until it ends. Before the supervisor hears that, this host is there for the next.
///
/// # Errors
/// `Interrupted` if the program was asked to stop; all else is told to the supervisor.
fn look_after(
    engine: &Engine,
    question: engine::Question,
    invitation: &Invitation,
    is_busy: &AtomicBool,
    tell: &impl Fn(&str),
) -> Result<()> {
    let joined = Steward::join(engine, invitation, &question.policy());
    let mut steward = match joined {
        Ok(steward) => steward,
        Err(e) => {
            tell(&plain(&format!("did not join a swarm: {e}")));
            is_busy.store(false, Ordering::Relaxed);
            question.answer(say(&Answer::No(e.to_string())));
            return Ok(());
        }
    };
    let agents: Vec<String> = members_of(steward.own).map(|agent| agent.to_string()).collect();
    tell(&format!("joined swarm {} with agents {}", invitation.example.address.tag, agents.join(", ")));
    question.answer(say(&Answer::Yes));
    let ended = steward.run();
    let line = steward.leave();
    is_busy.store(false, Ordering::Relaxed);
    match ended {
        Ok(()) => {
            tell("the swarm has ended");
            line.say(say(&Event::Left));
        }
        Err(e) => {
            tell(&plain(&format!("the swarm has ended: {e}")));
            line.say(say(&Event::Failed(e.to_string())));
            if matches!(e, Error::Interrupted(_)) {
                return Err(e);
            }
        }
    }
    Ok(())
}

/// Answers messages of a measurement until it ends.
fn be_measured(
    engine: &Engine,
    at: &str,
    question: engine::Question,
    echo: &Echo,
    is_busy: &AtomicBool,
    tell: &impl Fn(&str),
) -> Result<()> {
    let served = match Way::open_for(engine, at, echo) {
        Ok((way, port)) => {
            question.answer(say(&Answer::At(port)));
            way.serve(engine.patience.arrival())
        }
        Err(e) => {
            question.answer(say(&Answer::No(e.to_string())));
            Err(e)
        }
    };
    is_busy.store(false, Ordering::Relaxed);
    match served {
        Ok(line) => line.say(say(&Event::Left)),
        Err(e @ Error::Interrupted(_)) => return Err(e),
        Err(e) => tell(&plain(&format!("cannot be measured: {e}"))),
    }
    Ok(())
}
