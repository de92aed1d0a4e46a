//! The networks: what an agent decides and imputes with, and the file they are kept in.

pub mod kernels;
