//! How long things take: the measurements behind `bench latency`, `bench agent` and `bench spawn`.

mod distribution;
mod growth;
mod memory;
mod played;

pub use distribution::{Distribution, OVERRUN};
pub use growth::exponent;
pub use memory::Memory;
pub use played::{Played, Setup};
