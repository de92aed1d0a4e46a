//! Links in a chain: what a session is given.

use super::{Address, Context, Fates, Level, Link};
use crate::base::error::Result;
use crate::usage;

/// The links of a session, in a chain. Each may lose or postpone what the ones before it deliver.
#[derive(Debug)]
pub struct Links {
    chain: Vec<Box<dyn Link>>,
    share_at_start: bool,
}

/// The most ticks by which anything may be postponed. Messages are kept for that long, in shared memory.
pub const LONGEST_DELAY: u8 = 100;

/// The most ticks ago that what reaches an agent may have been observed, over links that postpone by up to `longest_delay`.
pub(crate) fn longest_age(longest_delay: u8, relay: bool, episode_steps: usize) -> u8 {
    // Nothing is older than its episode.
    let oldest = episode_steps.min(LONGEST_DELAY.into()) as u8;
    if relay { oldest } else { longest_delay }
}

impl Links {
    /// These links in this order. An observation is delivered if all of them deliver it, and their delays add up. At
    /// t = 0 everything is delivered at once regardless (the paper's `comm_at_t0`).
    ///
    /// # Errors
    /// `Usage` if together they postpone by more than [`LONGEST_DELAY`] ticks.
    pub fn chain(chain: Vec<Box<dyn Link>>) -> Result<Links> {
        let longest: u32 = chain.iter().map(|link| u32::from(link.longest_delay())).sum();
        if longest > LONGEST_DELAY.into() {
            return Err(usage!(
                "these links postpone by up to {longest} ticks, but messages are kept for {LONGEST_DELAY}; take \
                 shorter delays"
            ));
        }
        Ok(Links { chain, share_at_start: true })
    }

    /// Links that deliver with probability p.
    pub fn level(p: f64) -> Links {
        Links::from(Level { p })
    }

    /// Whether everything is delivered at once at t = 0.
    pub fn sharing_at_start(self, share_at_start: bool) -> Links {
        Links { share_at_start, ..self }
    }

    /// An episode begins in this world.
    pub fn begin(&mut self, world: usize, episode: u64) {
        self.chain.iter_mut().for_each(|link| link.begin(world, episode));
    }

    /// Writes what becomes of everything that is sent at this step in this world.
    pub fn deliveries(&mut self, context: &Context, fates: &mut Fates) -> Result<()> {
        fates.deliver_all();
        for (link, position) in self.chain.iter_mut().zip(0..) {
            let address = Address { position, ..context.address };
            link.deliveries(&Context { address, ..*context }, fates)?;
        }
        if context.address.step == 0 && self.share_at_start {
            fates.deliver_all();
        }
        Ok(())
    }

    /// The most ticks by which anything is postponed.
    pub fn longest_delay(&self) -> u8 {
        self.chain.iter().map(|link| link.longest_delay()).sum()
    }

    /// The probability of the first level in the chain, to be changed while it plays; `None` if there is no level.
    pub(crate) fn dial(&mut self) -> Option<&mut f64> {
        self.chain.iter_mut().find_map(|link| link.dial())
    }

    /// The one probability with which every link delivers in an episode, if there is one.
    pub(crate) fn level_of(&self, seed: u64, episode: u64) -> Option<f64> {
        let positions = self.chain.iter().zip(0..);
        let levels =
            positions.map(|(link, position)| link.level(&Address { seed, position, episode, step: 0 }));
        levels.product()
    }
}

impl<L: Link + 'static> From<L> for Links {
    fn from(link: L) -> Links {
        Links { chain: vec![Box::new(link)], share_at_start: true }
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec2;

    use super::super::testing::{context, rows_of};
    use super::*;

    /// Postpones one link, where there are places.
    #[derive(Debug)]
    struct Slow(u8);

    impl Link for Slow {
        fn deliveries(&mut self, context: &Context, fates: &mut Fates) -> Result<()> {
            context.places()?;
            fates.postpone(0, 1, self.0);
            Ok(())
        }

        fn longest_delay(&self) -> u8 {
            self.0
        }
    }

    #[test]
    fn sharing_at_the_start_can_be_turned_off() {
        let start = |share| rows_of(&mut Links::level(0.0).sharing_at_start(share), 0, 0, 3);
        assert_eq!(start(true), [0b111; 3]);
        assert_eq!(start(false), [0b001, 0b010, 0b100]);
    }

    #[test]
    fn delays_beyond_what_messages_are_kept_for_are_refused() {
        let chain = |delays: [u8; 2]| Links::chain(delays.map(|ticks| Box::new(Slow(ticks)) as _).into());
        assert_eq!(chain([40, 60]).unwrap().longest_delay(), 100);
        let error = chain([40, 61]).unwrap_err().to_string();
        assert!(error.contains("up to 101 ticks") && error.contains("kept for 100"), "{error}");
    }

    #[test]
    fn links_that_need_places_say_so_where_there_are_none() {
        let mut links = Links::chain(vec![Box::new(Slow(3))]).unwrap();
        let mut fates = Fates::new(2);
        let error = links.deliveries(&context(0, 1), &mut fates).unwrap_err().to_string();
        assert!(error.contains("no places"), "{error}");
        let positions = &[DVec2::ZERO; 2][..];
        links.deliveries(&Context { positions: Some(positions), ..context(0, 1) }, &mut fates).unwrap();
        assert_eq!((fates.delay(0, 1), fates.delay(1, 0)), (Some(3), Some(0)));
    }

    #[test]
    fn one_level_holds_for_all_links_where_each_link_has_one() {
        assert_eq!(Links::level(0.5).level_of(1, 2), Some(0.5));
        let both = Links::chain(vec![Box::new(Level { p: 0.5 }), Box::new(Level { p: 0.25 })]).unwrap();
        assert_eq!(both.level_of(1, 2), Some(0.125));
        let with_another = Links::chain(vec![Box::new(Level { p: 0.5 }), Box::new(Slow(1))]).unwrap();
        assert_eq!(with_another.level_of(1, 2), None);
    }
}
