//! A link of one's own: at each step one agent is heard, by turns, as on a radio channel that all share.
//!
//!     cargo run --example own_link
//!
//! Links are in the supervisor: agents are told what has reached them, and need to know nothing of this.

use vamaro_swarm::agent::Registry;
use vamaro_swarm::base::error::Result;
use vamaro_swarm::link::{Context, Fates, Link, LinkSpec, Links};
use vamaro_swarm::{Swarm, run_if_agent};

#[derive(Debug)]
struct ByTurns;

impl Link for ByTurns {
    fn deliveries(&mut self, context: &Context, fates: &mut Fates) -> Result<()> {
        let agents = fates.agents();
        let speaks = context.address.step as usize % agents;
        for sender in (0..agents).filter(|sender| *sender != speaks) {
            (0..agents).for_each(|receiver| fates.lose(receiver, sender));
        }
        Ok(())
    }
}

fn main() -> Result<()> {
    run_if_agent(&Registry::default());

    let by_chance = LinkSpec::parse("level(0.25)", 4)?.build();
    for (name, links) in [("by turns", Links::from(ByTurns)), ("by chance", by_chance)] {
        let mut swarm = Swarm::builder().environment("spread-xy-4").links(links).worlds(10).build()?;
        let statistics = swarm.play(100)?;
        let delivered = 100.0 * statistics.delivery_rate().unwrap_or_default();
        println!("{name}: {delivered:.1} % delivered, return {:.1}", statistics.return_mean());
    }
    Ok(())
}
