//! What stands for the runtime in a program that is built without it: there are no graphs to run.

use super::Port;

/// Does `work`: there is no other thread.
pub(in crate::nn) fn at_home<T: Send>(work: impl FnOnce() -> T + Send) -> T {
    work()
}

/// No graph.
#[derive(Debug)]
pub(super) enum Runtime {}

impl Runtime {
    pub fn load(_: Vec<u8>) -> Result<Runtime, String> {
        Err("this program is built without ONNX; build it with `--features onnx`".to_owned())
    }

    pub fn inputs(&self) -> &[Port] {
        match *self {}
    }

    pub fn outputs(&self) -> &[Port] {
        match *self {}
    }

    pub fn run(
        &self,
        _: usize,
        _: &[Vec<f32>],
        _: impl FnMut(usize, &[Vec<f32>]) -> Result<(), String> + Send,
    ) -> Result<(), String> {
        match *self {}
    }
}
