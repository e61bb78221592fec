//! A table that prints aligned in a terminal.
//!
//! In: columns (with an alignment and perhaps a group above them) and rows of cells. Out: lines of
//! plain text, numbers to the right. The same table is turned into HTML by the report, so both
//! show the same. Left out: wide characters and wrapping; every cell is one line of narrow
//! characters.

use std::fmt::Write;

/// Where the text of a column stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Align {
    /// Words.
    Left,
    /// Numbers.
    Right,
}

/// What a cell means, for those who can show it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Tone {
    /// Nothing in particular.
    Plain,
    /// A limit was kept.
    Pass,
    /// A limit was not kept.
    Fail,
}

/// The head of a column.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Column {
    /// Its name.
    pub name: String,
    /// Where its cells stand.
    pub align: Align,
    /// Neighbours with the same group stand under one heading; empty for none.
    pub group: String,
}

impl Column {
    /// A column of words.
    pub fn text(name: &str) -> Self {
        Self {
            name: name.to_owned(),
            align: Align::Left,
            group: String::new(),
        }
    }

    /// A column of numbers.
    pub fn number(name: &str) -> Self {
        Self {
            name: name.to_owned(),
            align: Align::Right,
            group: String::new(),
        }
    }

    /// The same column under a group heading.
    pub fn under(mut self, group: &str) -> Self {
        self.group = group.to_owned();
        self
    }
}

/// One cell.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Cell {
    /// Its text.
    pub text: String,
    /// What it means.
    pub tone: Tone,
    /// Where a page leads from here; nowhere where empty. A terminal does not show it.
    pub link: String,
}

impl Cell {
    /// A cell of words.
    pub fn text(text: impl Into<String>) -> Self {
        Self {
            text: text.into(),
            tone: Tone::Plain,
            link: String::new(),
        }
    }

    /// The same cell as a link to a page, by its relative URL.
    pub fn to(mut self, url: &str) -> Self {
        self.link = url.to_owned();
        self
    }

    /// A number with this many decimals; a dash when it is absent or not finite.
    pub fn number(value: Option<f64>, decimals: usize) -> Self {
        Self::text(format_number(value, decimals))
    }

    /// A word for a limit that was kept or not.
    pub fn verdict(pass: bool, kept: &str, broken: &str) -> Self {
        let tone = if pass { Tone::Pass } else { Tone::Fail };
        Self {
            tone,
            ..Self::text(if pass { kept } else { broken })
        }
    }
}

/// A table with a row for each value of a list, made column by column: each has a name, a format
/// and what it shows of a value.
pub struct Rows<'a, R> {
    of: &'a [R],
    table: Table,
}

impl<'a, R> Rows<'a, R> {
    /// A table of these values, still without columns.
    pub fn of(title: &str, values: &'a [R]) -> Self {
        let mut table = Table::new(title, Vec::new());
        table.rows = vec![Vec::new(); values.len()];
        Self { of: values, table }
    }

    /// The table.
    pub fn table(self) -> Table {
        self.table
    }

    /// A column of words.
    pub fn text<T: ToString>(self, name: &str, of: impl Fn(&'a R) -> T) -> Self {
        self.column(Column::text(name), |row| Cell::text(of(row).to_string()))
    }

    /// A column of whole numbers.
    pub fn count<T: ToString>(self, name: &str, of: impl Fn(&'a R) -> T) -> Self {
        self.column(Column::number(name), |row| Cell::text(of(row).to_string()))
    }

    /// A column of numbers with this many decimals.
    pub fn number<T: Into<Option<f64>>>(
        self,
        name: &str,
        decimals: usize,
        of: impl Fn(&'a R) -> T,
    ) -> Self {
        let cell = |row| Cell::number(of(row).into(), decimals);
        self.column(Column::number(name), cell)
    }

    /// A column of limits that were kept or not, and the word for each.
    pub fn verdict(self, name: &str, words: [&str; 2], of: impl Fn(&'a R) -> bool) -> Self {
        let [kept, broken] = words;
        self.column(Column::text(name), |row| {
            Cell::verdict(of(row), kept, broken)
        })
    }

    /// A column with cells of its own making.
    pub fn column(mut self, head: Column, cell: impl Fn(&'a R) -> Cell) -> Self {
        self.table.columns.push(head);
        for (cells, value) in self.table.rows.iter_mut().zip(self.of) {
            cells.push(cell(value));
        }
        self
    }

    /// Puts the column that was added last under a group heading.
    pub fn under(mut self, group: &str) -> Self {
        if let Some(last) = self.table.columns.last_mut() {
            last.group = group.to_owned();
        }
        self
    }
}

/// A number with this many decimals, `-` when it is absent or not finite, and no minus before 0.
pub fn format_number(value: Option<f64>, decimals: usize) -> String {
    let Some(value) = value.filter(|value| value.is_finite()) else {
        return "-".to_owned();
    };
    let text = format!("{value:.decimals$}");
    match text.strip_prefix('-') {
        Some(digits) if digits.chars().all(|c| c == '0' || c == '.') => digits.to_owned(),
        _ => text,
    }
}

/// A table: title, columns, rows and the sentences below it.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Table {
    /// Stands above it.
    pub title: String,
    /// Heads of the columns.
    pub columns: Vec<Column>,
    /// Rows of cells; a short row is filled with empty cells, a long one is cut.
    pub rows: Vec<Vec<Cell>>,
    /// Sentences that stand below it.
    pub notes: Vec<String>,
}

impl Table {
    /// An empty table.
    pub fn new(title: &str, columns: Vec<Column>) -> Self {
        Self {
            title: title.to_owned(),
            columns,
            ..Self::default()
        }
    }

    /// The table with a sentence below it.
    pub fn noted(mut self, note: impl Into<String>) -> Self {
        self.notes.push(note.into());
        self
    }

    /// Neighbouring columns of the same group: name and number of columns. Columns without a
    /// group each stand alone.
    pub fn groups(&self) -> Vec<(&str, usize)> {
        let mut groups: Vec<(&str, usize)> = Vec::new();
        for column in &self.columns {
            match groups.last_mut() {
                Some((name, count)) if !name.is_empty() && *name == column.group => *count += 1,
                _ => groups.push((&column.group, 1)),
            }
        }
        groups
    }

    /// The table as lines of text, each ended by a line feed.
    pub fn to_text(&self) -> String {
        let widths = self.widths();
        let mut out = String::new();
        if !self.title.is_empty() {
            let _ = writeln!(out, "{}", self.title);
        }
        if self.columns.iter().any(|column| !column.group.is_empty()) {
            self.push_group_line(&widths, &mut out);
        }
        let names: Vec<&str> = self
            .columns
            .iter()
            .map(|column| column.name.as_str())
            .collect();
        self.push_line(&names, &widths, &mut out);
        let rule: Vec<String> = widths.iter().map(|width| "-".repeat(*width)).collect();
        let rule: Vec<&str> = rule.iter().map(String::as_str).collect();
        self.push_line(&rule, &widths, &mut out);
        for row in &self.rows {
            let cells: Vec<&str> = row.iter().map(|cell| cell.text.as_str()).collect();
            self.push_line(&cells, &widths, &mut out);
        }
        for note in &self.notes {
            out.push_str(&wrap(note, 96));
        }
        out
    }

    /// Width of each column: its widest cell or name, and together wide enough for the group.
    fn widths(&self) -> Vec<usize> {
        let mut widths: Vec<usize> = self.columns.iter().map(|c| width(&c.name)).collect();
        for row in &self.rows {
            for (place, cell) in widths.iter_mut().zip(row) {
                *place = (*place).max(width(&cell.text));
            }
        }
        let mut first = 0;
        for (name, count) in self.groups() {
            let members = widths.get_mut(first..first + count).unwrap_or_default();
            let have = members.iter().sum::<usize>() + 2 * (count - 1);
            if let Some(place) = members.first_mut() {
                *place += width(name).saturating_sub(have);
            }
            first += count;
        }
        widths
    }

    /// Two spaces between columns, a bar before each group.
    fn gap_before(&self, index: usize) -> &'static str {
        if index == 0 {
            return "";
        }
        let (here, before) = (self.columns.get(index), self.columns.get(index - 1));
        if here.map(|c| &c.group) == before.map(|c| &c.group) {
            "  "
        } else {
            " | "
        }
    }

    fn push_group_line(&self, widths: &[usize], out: &mut String) {
        let mut line = String::new();
        let mut first = 0;
        for (name, count) in self.groups() {
            line.push_str(self.gap_before(first));
            let space = widths.iter().skip(first).take(count).sum::<usize>() + 2 * (count - 1);
            line.push_str(&format!("{name:<space$}"));
            first += count;
        }
        let _ = writeln!(out, "{}", line.trim_end());
    }

    fn push_line(&self, cells: &[&str], widths: &[usize], out: &mut String) {
        let mut line = String::new();
        for (index, (column, width)) in self.columns.iter().zip(widths).enumerate() {
            let text = cells.get(index).copied().unwrap_or_default();
            line.push_str(self.gap_before(index));
            line.push_str(&match column.align {
                Align::Left => format!("{text:<width$}"),
                Align::Right => format!("{text:>width$}"),
            });
        }
        let _ = writeln!(out, "{}", line.trim_end());
    }
}

/// Breaks a sentence at spaces into lines of at most `columns` characters; a longer word stays
/// whole.
pub fn wrap(text: &str, columns: usize) -> String {
    let mut out = String::new();
    let mut used = 0;
    for word in text.split_whitespace() {
        let needed = width(word);
        if used > 0 && used + 1 + needed > columns {
            out.push('\n');
            used = 0;
        }
        if used > 0 {
            out.push(' ');
            used += 1;
        }
        out.push_str(word);
        used += needed;
    }
    out.push('\n');
    out
}

/// Number of characters.
fn width(text: &str) -> usize {
    text.chars().count()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table() -> Table {
        let columns = vec![
            Column::text("Axis"),
            Column::number("Node 1").under("Published"),
            Column::number("Node 2").under("Published"),
            Column::number("N").under("A longer heading"),
        ];
        let mut table = Table::new("Table", columns);
        let numbers = [Some(0.106), Some(-12.5), None];
        let mut row = vec![Cell::text("X")];
        row.extend(numbers.map(|value| Cell::number(value, 3)));
        table.rows = vec![row, vec![Cell::text("Y, short")]];
        table
    }

    #[test]
    fn numbers_stand_to_the_right_below_their_group() {
        let expected = "\
Table
         | Published       | A longer heading
Axis     | Node 1   Node 2 |                N
-------- | ------  ------- | ----------------
X        |  0.106  -12.500 |                -
Y, short |                 |
";
        assert_eq!(table().to_text(), expected);
    }

    #[test]
    fn a_group_heading_never_runs_into_the_next_column() {
        let text = table().to_text();
        let at = |line: usize| text.lines().nth(line).unwrap().rfind('|').unwrap();
        assert_eq!(at(1), at(2));
        assert_eq!(at(2), at(4));
    }

    #[test]
    fn a_table_is_made_column_by_column() {
        let made = Rows::of("Squares", &[-1.0, 2.0])
            .text("Of", |x| format!("{x:.0}"))
            .number("Square", 1, |x| x * x)
            .under("Exact")
            .count("Roots", |x| if *x < 0.0 { 0 } else { 2 })
            .verdict("Root", ["yes", "NO"], |x| *x >= 0.0)
            .table();
        let expected = "\
Squares
   | Exact  |
Of | Square | Roots  Root
-- | ------ | -----  ----
-1 |    1.0 |     0  NO
2  |    4.0 |     2  yes
Seen.
";
        assert_eq!(made.noted("Seen.").to_text(), expected);
    }

    #[test]
    fn absent_and_odd_numbers_print_as_a_dash() {
        assert_eq!(format_number(None, 3), "-");
        assert_eq!(format_number(Some(f64::NAN), 3), "-");
        assert_eq!(format_number(Some(f64::INFINITY), 0), "-");
        assert_eq!(format_number(Some(-0.0004), 3), "0.000");
        assert_eq!(format_number(Some(-0.0006), 3), "-0.001");
    }

    #[test]
    fn a_long_note_is_broken_at_spaces() {
        assert_eq!(wrap("one two three", 7), "one two\nthree\n");
        assert_eq!(wrap("incontestable no", 5), "incontestable\nno\n");
        let mut table = table();
        table.notes.push("word ".repeat(60));
        assert!(table.to_text().lines().all(|line| line.len() <= 96));
    }

    #[test]
    fn an_empty_table_is_its_heading() {
        let table = Table::new("", vec![Column::text("A"), Column::number("B")]);
        assert_eq!(table.to_text(), "A  B\n-  -\n");
        assert_eq!(Table::default().to_text(), "\n\n");
    }

    #[test]
    fn a_row_that_is_too_long_is_cut() {
        let mut table = Table::new("", vec![Column::text("A")]);
        table.rows.push(vec![Cell::text("a"), Cell::text("lost")]);
        assert_eq!(table.to_text(), "A\n-\na\n");
    }
}
