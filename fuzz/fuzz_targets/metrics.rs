#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| vamaro_swarm::fuzzing::metrics(bytes));
