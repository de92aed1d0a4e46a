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

/// Which observations links lost, where nothing is shared at the start.
pub(super) struct Losses {
    text: String,
    /// Links but those of an agent to itself, `[episode][step][link]`.
    pub episodes: Vec<Vec<Vec<bool>>>,
}

impl Losses {
    /// Those of a team of four.
    pub fn of(text: &str) -> Losses {
        const AGENTS: usize = 4;
        let mut links = links(text).sharing_at_start(false);
        let mut episode = |episode| {
            links.begin(0, episode);
            let mut step = |step| {
                let rows = rows_of(&mut links, episode, step, AGENTS);
                let pairs = (0..AGENTS * AGENTS).map(|pair| (pair / AGENTS, pair % AGENTS));
                pairs.filter(|(i, j)| i != j).map(|(i, j)| rows[i] >> j & 1 == 0).collect()
            };
            (0..=STEPS).map(&mut step).collect()
        };
        Losses { text: text.to_owned(), episodes: (0..2000).map(&mut episode).collect() }
    }

    /// Holds the mean loss at each step of an episode to a five-sigma bound.
    pub fn check_every_step(&self, expected: impl Fn(usize) -> f64) {
        for step in 0..=STEPS as usize {
            self.check_share(&format!("lost at step {step}"), expected(step), |episode, link| {
                vec![episode[step][link]]
            });
        }
    }

    /// The same of how often something is so, of what a link did in an episode.
    pub fn check_share(&self, what: &str, expected: f64, is_so: impl Fn(&[Vec<bool>], usize) -> Vec<bool>) {
        let (mut count, mut n) = (0u32, 0u32);
        for episode in &self.episodes {
            for found in (0..episode[0].len()).flat_map(|link| is_so(episode, link)) {
                count += u32::from(found);
                n += 1;
            }
        }
        let (share, independent) = (f64::from(count) / f64::from(n), f64::from(self.episodes.len() as u32));
        // What one link does at several steps of an episode counts once.
        let links = self.episodes[0][0].len() as f64;
        let sigma = (expected * (1.0 - expected) / (independent * links)).sqrt();
        assert!((share - expected).abs() <= 5.0 * sigma, "{}, {what}: {share} is not {expected}", self.text);
    }
}

/// How often what is sent over each of 12 links in 400 episodes is delayed by each number of ticks: five-sigma bounds.
pub(super) fn check_delays(text: &str, expected: &[f64]) {
    const N: f64 = 400.0 * STEPS as f64 * 12.0;
    let mut links = links(text).sharing_at_start(false);
    let mut fates = Fates::new(4);
    let mut counts = vec![0u32; usize::from(links.longest_delay()) + 1];
    for (episode, step) in (0..400).flat_map(|episode| (0..STEPS).map(move |step| (episode, step))) {
        links.deliveries(&context(episode, step), &mut fates).unwrap();
        for (i, j) in (0..16).map(|link| (link / 4, link % 4)).filter(|(i, j)| i != j) {
            counts[usize::from(fates.delay(i, j).unwrap())] += 1;
        }
    }
    assert_eq!(counts.len(), expected.len(), "{text}");
    for (ticks, (count, p)) in counts.iter().zip(expected).enumerate() {
        let (share, sigma) = (f64::from(*count) / N, (p * (1.0 - p) / N).sqrt());
        assert!((share - p).abs() <= 5.0 * sigma, "{text}: {share} of {ticks} ticks, not {p}");
    }
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
