//! What results were made on, and when.

use crate::nn::kernels;

/// Model of the CPU and the instruction set that is used of it.
pub(crate) fn cpu() -> String {
    let info = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let model = info.lines().find_map(|line| line.strip_prefix("model name")?.split_once(':'));
    let model = model.map_or(std::env::consts::ARCH, |(_, model)| model.trim());
    format!("{model}, SIMD {}", kernels::instruction_set())
}

/// The day (UTC), as in 2026-02-28.
pub(crate) fn today() -> String {
    jiff::Timestamp::now().strftime("%F").to_string()
}
