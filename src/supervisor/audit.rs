//! The audit: where each part of each policy input came from, held against what was sent.

use std::fmt;
use std::time::Duration;

use super::{Decisions, Observer, Stage, Tick};
use crate::base::error::Result;
use crate::bus::NOT_ARRIVED;
use crate::environment::Spec;

/// Counts the parts of policy inputs by origin. A part is the unique part of one agent's observation.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct Audit {
    /// The agent's own.
    pub own: u64,
    /// Received from a peer.
    pub received: u64,
    /// Of those that are delayed, what was passed on by others than the peer itself. There are none where nobody relays.
    #[serde(skip_serializing_if = "is_zero")]
    pub relayed: u64,
    /// Imagined by the imputer with something in hand that a peer had sent at an earlier tick.
    pub delayed: u64,
    /// Imagined by the imputer alone.
    pub imputed: u64,
    /// Parts that the links delivered at this tick but the agent did not have when it decided. There are none in
    /// lockstep.
    pub late: u64,
    /// Own, received or common parts that are not, bit by bit, what the sensor said.
    pub altered: u64,
    /// Parts that the agent had although the links did not deliver them at this tick, or that had another age. Where agents
    /// relay: that were newer than anything the links had let through by then, over however many hops.
    pub leaked: u64,
}

impl Observer for Audit {
    fn ticked(&mut self, stage: &Stage, decisions: &Decisions, _exchange: Duration) -> Result<()> {
        for world in stage.playing() {
            self.look_at(stage.spec(), &stage.tick(), world, decisions);
        }
        Ok(())
    }
}

impl Audit {
    /// Looks at one tick of a world.
    fn look_at(&mut self, spec: &Spec, tick: &Tick, world: usize, decisions: &Decisions) {
        let agents = spec.n_agents();
        let (joint, predicted) = (spec.joint_dim(), spec.predicted_dim());
        let (unique, common) = (spec.unique_dim(), spec.common_dim());
        for agent in decisions.present(agents) {
            let row = agent * tick.worlds + world;
            let (arriving, used) = (tick.arriving(agent, world), decisions.used(tick, agent, world));
            let messages = tick.messages(agent, world);
            let estimate = &decisions.estimates[row * joint..(row + 1) * joint];
            for sender in 0..agents {
                let (arriving, used) = (arriving[sender], used[sender]);
                let part = &estimate[sender * unique..(sender + 1) * unique];
                let same = is_same(part, &tick.observation(spec, sender, world)[..unique]);
                match used {
                    _ if sender == agent => self.own += 1,
                    0 => self.received += 1,
                    NOT_ARRIVED => self.imputed += 1,
                    _ => self.delayed += 1,
                }
                self.relayed += u64::from(used != NOT_ARRIVED && used != messages[sender]);
                // Against the clock one path may have been late, and another not.
                let is_possible =
                    if tick.relays() { used >= tick.held(agent, world)[sender] } else { used == arriving };
                self.leaked += u64::from(used != NOT_ARRIVED && !is_possible);
                let there = decisions.absent >> sender & 1 == 0;
                self.late += u64::from(there && used == NOT_ARRIVED && arriving != NOT_ARRIVED);
                self.altered += u64::from((sender == agent || used == 0) && !same);
            }
            let own_common = &tick.observation(spec, agent, world)[unique..unique + common];
            self.altered += u64::from(!is_same(&estimate[predicted..], own_common));
        }
    }

    /// Whether every part was what it should be.
    pub fn holds(&self) -> bool {
        self.altered == 0 && self.leaked == 0
    }
}

impl fmt::Display for Audit {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let Audit { own, received, relayed, delayed, imputed, late, altered, leaked } = self;
        let total = (own + received + delayed + imputed).max(1) as f64 / 100.0;
        let of_these = if *relayed > 0 { format!(", {relayed} of them relayed") } else { String::new() };
        write!(
            f,
            "{own} own ({:.1} %), {received} received ({:.1} %), {delayed} delayed ({:.1} %{of_these}), {imputed} imputed \
             ({:.1} %); {late} late, {altered} altered, {leaked} leaked",
            *own as f64 / total,
            *received as f64 / total,
            *delayed as f64 / total,
            *imputed as f64 / total
        )
    }
}

fn is_zero(number: &u64) -> bool {
    *number == 0
}

fn is_same(a: &[f32], b: &[f32]) -> bool {
    a.iter().zip(b).all(|(a, b)| a.to_bits() == b.to_bits())
}
