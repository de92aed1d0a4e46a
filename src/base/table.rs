//! Tables for terminals, and numbers as people read them.

/// A table without borders, its columns as wide as they need to be.
pub fn table(header: &[&str], rows: impl IntoIterator<Item = Vec<String>>) -> String {
    let mut table = comfy_table::Table::new();
    table.load_style(comfy_table::presets::NOTHING).set_header(header).add_rows(rows);
    let padding = |line: &str| line.strip_prefix(' ').unwrap_or(line).trim_end().to_owned() + "\n";
    table.to_string().lines().map(padding).collect()
}

/// A number of steps with its unit: millions or thousands where there are some.
pub fn thousands(steps: u64) -> String {
    match steps {
        100_000.. => format!("{} M", steps as f64 / 1e6),
        1_000.. => format!("{} k", steps as f64 / 1e3),
        _ => steps.to_string(),
    }
}
