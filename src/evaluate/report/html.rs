//! Elements of an HTML page. Whatever is text is escaped.

use crate::plot::escape;

/// A page being written.
#[derive(Debug, Default)]
pub struct Html {
    text: String,
}

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
#[derive(Clone, Debug, Default)]
pub struct Cell {
    /// The value.
    pub value: String,
    /// Lines below it.
    pub notes: Vec<String>,
    /// Stands out.
    pub strong: bool,
}

impl Cell {
    /// A value alone.
    pub fn of(value: impl Into<String>) -> Cell {
        Cell { value: value.into(), ..Cell::default() }
    }
}

impl Html {
    /// HTML as it is.
    pub fn raw(&mut self, html: &str) {
        self.text.push_str(html);
        self.text.push('\n');
    }

    /// An element that holds text, such as a paragraph.
    pub fn element(&mut self, tag: &str, text: &str) {
        self.raw(&format!("<{tag}>{}</{tag}>", escape(text)));
    }

    /// Terms with what they mean.
    pub fn list(&mut self, terms: impl IntoIterator<Item = (String, String)>) {
        self.raw("<dl>");
        for (term, meaning) in terms {
            self.raw(&format!("<dt>{}</dt><dd>{}</dd>", escape(&term), escape(&meaning)));
        }
        self.raw("</dl>");
    }

    /// A table that scrolls where it is wider than the page.
    pub fn table(&mut self, table: &Table) {
        let caption = escape(&table.caption);
        self.raw(&format!(
            "<div class=\"scroll\" role=\"region\" tabindex=\"0\" aria-label=\"{caption}\"><table>\n\
             <caption>{caption}</caption>\n<thead><tr>"
        ));
        for column in &table.columns {
            self.raw(&format!("<th scope=\"col\">{}</th>", escape(column)));
        }
        self.raw("</tr></thead>\n<tbody>");
        for (heading, cells) in &table.rows {
            self.raw(&format!("<tr><th scope=\"row\">{}</th>", escape(heading)));
            for Cell { value, notes, strong } in cells {
                let notes: String =
                    notes.iter().map(|note| format!("<small>{}</small>", escape(note))).collect();
                let value = match strong {
                    true => format!("<strong>{}</strong>", escape(value)),
                    false => escape(value),
                };
                self.raw(&format!("<td>{value}{notes}</td>"));
            }
            self.raw("</tr>");
        }
        self.raw("</tbody></table></div>");
    }

    /// The page.
    pub fn finish(self) -> String {
        self.text
    }
}
