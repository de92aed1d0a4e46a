//! What a machine and its users do to the program: kills, full disks, limits, strange files, other users. A binary of its own,
//! because some of these tests fill shared memory or count what is there.

#[path = "../common/mod.rs"]
mod common;

mod files;
mod security;
