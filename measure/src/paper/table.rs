//! Tables: as comma-separated values for programs, as Markdown for readers.

use std::fmt::Write;

/// A value of a table.
#[derive(Clone, Debug, PartialEq)]
pub enum Cell {
    /// Words.
    Text(String),
    /// A whole number.
    Count(u64),
    /// A number, and how many decimals a reader wants of it. Files have all digits.
    Number(f64, usize),
    /// There is none.
    Missing,
}

impl From<&str> for Cell {
    fn from(text: &str) -> Cell {
        Cell::Text(text.to_owned())
    }
}

impl From<String> for Cell {
    fn from(text: String) -> Cell {
        Cell::Text(text)
    }
}

impl From<usize> for Cell {
    fn from(count: usize) -> Cell {
        Cell::Count(count as u64)
    }
}

impl From<u32> for Cell {
    fn from(count: u32) -> Cell {
        Cell::Count(count.into())
    }
}

impl Cell {
    /// A number, if there is one.
    pub fn number(value: Option<f64>, decimals: usize) -> Cell {
        value.map_or(Cell::Missing, |value| Cell::Number(value, decimals))
    }

    fn exact(&self) -> String {
        match self {
            Cell::Text(text) => quoted(text),
            Cell::Count(count) => count.to_string(),
            Cell::Number(value, _) => value.to_string(),
            Cell::Missing => String::new(),
        }
    }

    fn rounded(&self) -> String {
        match self {
            Cell::Text(text) => text.replace('|', "\\|").replace(['\n', '\r'], " "),
            Cell::Count(count) => count.to_string(),
            Cell::Number(value, decimals) => format!("{value:.decimals$}"),
            Cell::Missing => String::new(),
        }
    }
}

/// Text as a field of a CSV file (RFC 4180).
fn quoted(text: &str) -> String {
    match text.contains([',', '"', '\n', '\r']) {
        true => format!("\"{}\"", text.replace('"', "\"\"")),
        false => text.to_owned(),
    }
}

/// A table with a heading for every column.
#[derive(Clone, Debug, PartialEq)]
pub struct Table {
    columns: Vec<&'static str>,
    rows: Vec<Vec<Cell>>,
}

impl Table {
    /// A table without rows.
    pub fn new(columns: &[&'static str]) -> Table {
        Table { columns: columns.to_vec(), rows: Vec::new() }
    }

    /// Adds a row. Cells beyond the last column are left out, those that lack are missing.
    pub fn push(&mut self, mut row: Vec<Cell>) {
        row.resize(self.columns.len(), Cell::Missing);
        self.rows.push(row);
    }

    /// The rows.
    pub fn rows(&self) -> &[Vec<Cell>] {
        &self.rows
    }

    /// A line of headings and a line for each row; numbers with all their digits.
    pub fn csv(&self) -> String {
        let mut out = self.columns.iter().map(|name| quoted(name)).collect::<Vec<_>>().join(",");
        out.push('\n');
        for row in &self.rows {
            out += &row.iter().map(Cell::exact).collect::<Vec<_>>().join(",");
            out.push('\n');
        }
        out
    }

    /// A table of Markdown: numbers to the right, rounded.
    pub fn markdown(&self) -> String {
        let mut out = format!("| {} |\n|", self.columns.join(" | "));
        for column in 0..self.columns.len() {
            let text = self.rows.iter().any(|row| matches!(row[column], Cell::Text(_)));
            out += if text { "---|" } else { "---:|" };
        }
        out.push('\n');
        for row in &self.rows {
            let cells: Vec<String> = row.iter().map(Cell::rounded).collect();
            let _ = writeln!(out, "| {} |", cells.join(" | "));
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_have_all_digits_and_readers_some() {
        let mut table = Table::new(&["what", "how, much"]);
        table.push(vec!["a \"b\"|, c".into(), Cell::Number(1.0 / 3.0, 2)]);
        table.push(vec![Cell::Missing]);
        assert_eq!(table.csv(), "what,\"how, much\"\n\"a \"\"b\"\"|, c\",0.3333333333333333\n,\n");
        assert_eq!(
            table.markdown(),
            "| what | how, much |\n|---|---:|\n| a \"b\"\\|, c | 0.33 |\n|  |  |\n"
        );
    }
}
