//! Tables and text for terminals, and numbers as people read them.

/// The columns that everything for people keeps to: a terminal has so many at least.
pub const COLUMNS: usize = 80;

/// A table without borders, its columns as wide as they need to be.
pub fn table(header: &[&str], rows: impl IntoIterator<Item = Vec<String>>) -> String {
    let mut table = comfy_table::Table::new();
    table.load_style(comfy_table::presets::NOTHING).set_header(header).add_rows(rows);
    let padding = |line: &str| line.strip_prefix(' ').unwrap_or(line).trim_end().to_owned() + "\n";
    table.to_string().lines().map(padding).collect()
}

/// The same as so few tables, each with the first column, as it takes to keep to [`COLUMNS`].
pub fn tables(header: &[&str], rows: &[Vec<String>]) -> String {
    let with = |columns: std::ops::Range<usize>| {
        let header = [&header[..1], &header[columns.clone()]].concat();
        // Headings within a table have no cells.
        let cells = |row: &Vec<String>| {
            let there = row.get(columns.clone()).unwrap_or_default();
            row.iter().take(1).chain(there).cloned().collect()
        };
        table(&header, rows.iter().map(cells))
    };
    let fits = |table: &String| table.lines().all(|line| line.chars().count() <= COLUMNS);
    let (mut first, mut tables) = (1, Vec::new());
    while first < header.len() {
        let more = (first + 2..=header.len()).take_while(|end| fits(&with(first..*end)));
        let end = more.last().unwrap_or(first + 1);
        tables.push(with(first..end));
        first = end;
    }
    tables.join("\n")
}

/// A line of text as lines that keep to [`COLUMNS`], all but the first indented. What has no blank stays in one piece.
pub fn wrapped(text: &str, indent: usize) -> String {
    let (mut lines, mut length) = (String::new(), 0);
    for (at, word) in text.split(' ').enumerate() {
        let width = word.chars().count();
        if at == 0 {
            length = width;
        } else if length + 1 + width <= COLUMNS || length <= indent {
            lines.push(' ');
            length += 1 + width;
        } else {
            lines.push('\n');
            lines.extend(std::iter::repeat_n(' ', indent));
            length = indent + width;
        }
        lines.push_str(word);
    }
    lines
}

/// `1 episode`, `2 episodes`.
pub fn counted(n: u64, what: &str) -> String {
    format!("{n} {what}{}", if n == 1 { "" } else { "s" })
}

/// A number of steps with its unit: millions or thousands where there are some.
pub fn thousands(steps: u64) -> String {
    match steps {
        100_000.. => format!("{} M", steps as f64 / 1e6),
        1_000.. => format!("{} k", steps as f64 / 1e3),
        _ => steps.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_table_that_is_too_wide_becomes_several() {
        let names: Vec<String> = (0..12).map(|at| format!("column {at:05}")).collect();
        let mut header = vec!["name"];
        header.extend(names.iter().map(String::as_str));
        let row: Vec<String> =
            std::iter::once("row").chain(header[1..].iter().copied()).map(str::to_owned).collect();
        let text = tables(&header, &[row, vec!["heading".to_owned()]]);
        assert!(text.lines().all(|line| line.chars().count() <= COLUMNS), "{text}");
        assert_eq!(text.matches("heading").count(), 3, "five, five and two columns: {text}");
        for name in &names {
            assert_eq!(text.matches(name.as_str()).count(), 2, "{text}");
        }
        let narrow = [vec!["a".to_owned(), "1".to_owned()]];
        assert_eq!(tables(&["name", "value"], &narrow), table(&["name", "value"], narrow.clone()));
    }

    #[test]
    fn lines_end_at_a_blank() {
        let text = format!("ok      {}", "word ".repeat(30).trim_end());
        let lines = wrapped(&text, 8);
        assert!(lines.lines().all(|line| line.len() <= COLUMNS && !line.ends_with(' ')), "{lines}");
        assert!(lines.lines().skip(1).all(|line| line.starts_with("        word")), "{lines}");
        assert_eq!(lines.split_whitespace().count(), 31);
        assert_eq!(wrapped("short, with  blanks", 4), "short, with  blanks");
        let path = "x".repeat(90);
        assert_eq!(wrapped(&format!("in {path} here"), 2), format!("in {path}\n  here"));
    }
}
