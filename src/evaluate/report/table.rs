//! Tables of the page, with one number in a cell.

use maud::{Markup, html};

/// A table with a heading for each row.
#[derive(Debug)]
pub struct Table {
    /// What it shows.
    pub caption: String,
    /// Heads of all columns, that of the rows' headings first.
    pub columns: Vec<String>,
    /// The heading of each row, and its cells.
    pub rows: Vec<(String, Vec<Cell>)>,
}

/// A cell of a table.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Cell {
    /// What is in it.
    pub value: String,
    /// Stands out.
    pub strong: bool,
    /// Where it leads.
    pub link: Option<String>,
}

impl Cell {
    /// A value like others.
    pub fn of(value: impl Into<String>) -> Cell {
        Cell { value: value.into(), strong: false, link: None }
    }

    /// Nothing.
    pub fn none() -> Cell {
        Cell::of("-")
    }
}

impl Table {
    /// Scrolls where it is wider than the page.
    pub fn markup(&self) -> Markup {
        let Table { caption, columns, rows } = self;
        html! {
            div.scroll role="region" tabindex="0" aria-label=(caption) {
                table {
                    caption { (caption) }
                    thead { tr { @for column in columns { th scope="col" { (column) } } } }
                    tbody {
                        @for (heading, cells) in rows {
                            tr {
                                th scope="row" { (heading) }
                                @for Cell { value, strong, link } in cells {
                                    td {
                                        @if let Some(link) = link { a href=(link) { (value) } }
                                        @else if *strong { strong { (value) } }
                                        @else { (value) }
                                    }
                                }
                            }
                        }
                    }
                }
            }
        }
    }
}

/// Tables that are shown on demand.
pub fn on_demand(summary: &str, tables: &[Table]) -> Markup {
    html! {
        @if !tables.is_empty() {
            details {
                summary { (summary) }
                @for table in tables { (table.markup()) }
            }
        }
    }
}
