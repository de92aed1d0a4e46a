//! What tests of links ask of them.

use super::{Address, Context, Fates, LinkSpec, Links};

/// Steps of an episode.
pub(super) const STEPS: u64 = 25;

/// What is asked at a step of an episode, with draws from one seed.
pub(super) fn context(episode: u64, step: u64) -> Context<'static> {
    let address = Address { seed: 11, position: 0, episode, step };
    Context { address, world: 0, bytes: 32, positions: None }
}

/// The links that `text` says.
pub(super) fn links(text: &str) -> Links {
    LinkSpec::parse(text, 2).unwrap().build()
}

/// Whom each receiver receives.
pub(super) fn rows(text: &str, episode: u64, step: u64, agents: usize) -> Vec<u64> {
    rows_of(&mut links(text), episode, step, agents)
}

/// The same, of links whose episode has begun.
pub(super) fn rows_of(links: &mut Links, episode: u64, step: u64, agents: usize) -> Vec<u64> {
    let mut fates = Fates::new(agents);
    links.deliveries(&context(episode, step), &mut fates).unwrap();
    let bit = |receiver, sender| u64::from(fates.delay(receiver, sender).is_some()) << sender;
    (0..agents).map(|receiver| (0..agents).map(|sender| bit(receiver, sender)).sum()).collect()
}

/// Counts deliveries over i != j and t >= 1 and holds them to a five-sigma binomial bound.
pub(super) fn check_rate(text: &str, expected: f64) {
    let (agents, episodes) = (4, 400);
    let mut links = links(text);
    let mut delivered = 0u32;
    let mut total = 0u32;
    for episode in 0..episodes {
        for step in 1..STEPS {
            for (i, row) in rows_of(&mut links, episode, step, agents).into_iter().enumerate() {
                delivered += (row & !(1 << i)).count_ones();
                total += agents as u32 - 1;
            }
        }
    }
    let rate = f64::from(delivered) / f64::from(total);
    let sigma = (expected * (1.0 - expected) / f64::from(total)).sqrt();
    assert!((rate - expected).abs() <= 5.0 * sigma, "{text}: {rate} is not {expected}");
}
