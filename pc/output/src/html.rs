//! Pieces of HTML: escaped text, tables and the frame of a page.
//!
//! In: plain text and [`Table`]s. Out: HTML that needs nothing from outside: the style sheet is
//! part of the page, there is no script, no font and no picture to fetch.

use std::fmt::Write;

use crate::chart::Chart;
use crate::table::{Align, Cell, Column, Table, Tone};

/// Colours and boxes that all pages share, also those that are served.
pub const BASE: &str = include_str!("base.css");

/// The style sheet of reports, behind [`BASE`].
const STYLE: &str = include_str!("style.css");

/// Text that is safe between tags and inside a quoted attribute, of HTML and of XML 1.0 (2.2 and
/// 2.4). Characters that either does not allow (controls, U+FFFE, U+FFFF) become spaces.
pub fn escape(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for character in text.chars() {
        match character {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            '\'' => out.push_str("&#39;"),
            '\u{FFFE}' | '\u{FFFF}' => out.push(' '),
            character if character.is_control() => out.push(' '),
            character => out.push(character),
        }
    }
    out
}

/// A whole page with this title and this body, which is HTML.
pub fn page(title: &str, body: &str) -> String {
    format!(
        "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <title>{}</title>\n<style>\n{BASE}{STYLE}</style>\n</head>\n\
         <body>\n{body}</body>\n</html>\n",
        escape(title)
    )
}

/// The head of a page: its title, what it is about, and more, which is HTML.
pub fn header(title: &str, lead: &str, more: &str) -> String {
    format!(
        "<header>\n<h1>{}</h1>\n<p class=\"lead\">{}</p>\n{more}</header>\n",
        escape(title),
        escape(lead)
    )
}

/// A part of a page under its heading; the content is HTML.
pub fn section(title: &str, content: &str) -> String {
    let title = escape(title);
    format!("<section>\n<h2>{title}</h2>\n{content}</section>\n")
}

/// Charts side by side.
pub fn charts(charts: &[Chart]) -> String {
    let all: String = charts.iter().map(Chart::html).collect();
    format!("<div class=\"charts\">\n{all}</div>\n")
}

/// The last line of a page: that the same figures are in `report.json`, and in which format.
pub fn footer(format: &str, version: u32, more: &str) -> String {
    let text = format!(
        "The same figures are in report.json in the same folder (format {format}, version \
         {version}).{more}"
    );
    format!("<footer>{}</footer>\n", paragraph(&text))
}

/// A paragraph.
pub fn paragraph(text: &str) -> String {
    format!("<p>{}</p>\n", escape(text))
}

/// A line of small facts: name and value.
pub fn facts(pairs: &[(&str, String)]) -> String {
    let entries: String = pairs
        .iter()
        .map(|(name, value)| {
            format!(
                "<div><dt>{}</dt><dd>{}</dd></div>",
                escape(name),
                escape(value)
            )
        })
        .collect();
    format!("<dl class=\"facts\">{entries}</dl>\n")
}

/// The verdict of a page, in a word and a colour.
pub fn verdict(pass: bool, text: &str) -> String {
    let class = if pass { "pass" } else { "fail" };
    format!("<p class=\"verdict {class}\">{}</p>\n", escape(text))
}

/// A table under its title; it scrolls sideways where it is too wide. A table without rows is a
/// sentence that states this.
pub fn table(table: &Table) -> String {
    let title = escape(&table.title);
    let mut out = format!("<h3>{title}</h3>\n");
    if table.rows.is_empty() {
        out.push_str("<p class=\"empty\">Not run.</p>\n");
        return out;
    }
    let _ = write!(
        out,
        "<div class=\"scroll\" tabindex=\"0\" role=\"region\" aria-label=\"{title}\"><table>\n\
         <thead>\n{}</thead>\n<tbody>\n",
        head(table)
    );
    for (index, row) in table.rows.iter().enumerate() {
        let cells: String = (0..table.columns.len())
            .map(|column| body_cell(table, row.get(column), column))
            .collect();
        let class = if begins_block(table, index) {
            " class=\"new\""
        } else {
            ""
        };
        let _ = writeln!(out, "<tr{class}>{cells}</tr>");
    }
    out.push_str("</tbody>\n</table></div>\n");
    for note in &table.notes {
        let _ = writeln!(out, "<p class=\"note\">{}</p>", escape(note));
    }
    out
}

/// Whether a row begins another block: its first cell differs from the one above, in a table
/// where neighbours share it.
fn begins_block(table: &Table, index: usize) -> bool {
    let first = |index: usize| table.rows.get(index).and_then(|row| row.first());
    let shared = (1..table.rows.len()).any(|index| first(index) == first(index - 1));
    shared && index > 0 && first(index) != first(index - 1)
}

/// One or two rows of column heads.
fn head(table: &Table) -> String {
    let mut out = String::new();
    if table.columns.iter().any(|column| !column.group.is_empty()) {
        out.push_str("<tr>");
        let mut first = 0;
        for (name, count) in table.groups() {
            let class = classes(table, first, Align::Left, "");
            let tag = if name.is_empty() {
                "td"
            } else {
                "th scope=\"colgroup\""
            };
            let end = if name.is_empty() { "td" } else { "th" };
            let _ = write!(
                out,
                "<{tag} colspan=\"{count}\"{class}>{}</{end}>",
                escape(name)
            );
            first += count;
        }
        out.push_str("</tr>\n");
    }
    out.push_str("<tr>");
    for (index, column) in table.columns.iter().enumerate() {
        let class = classes(table, index, column.align, "");
        let _ = write!(
            out,
            "<th scope=\"col\"{class}>{}</th>",
            escape(&column.name)
        );
    }
    out.push_str("</tr>\n");
    out
}

fn body_cell(table: &Table, cell: Option<&Cell>, index: usize) -> String {
    let (text, tone) = cell.map_or(("", Tone::Plain), |cell| (&cell.text, cell.tone));
    let extra = match tone {
        Tone::Pass => "pass",
        Tone::Fail => "fail",
        Tone::Plain if text.chars().count() > 28 => "long",
        Tone::Plain => "",
    };
    let align = table
        .columns
        .get(index)
        .map_or(Align::Left, |column| column.align);
    let class = classes(table, index, align, extra);
    let (open, close) = if index == 0 {
        ("th scope=\"row\"", "th")
    } else {
        ("td", "td")
    };
    let text = match cell.map_or("", |cell| cell.link.as_str()) {
        "" => escape(text),
        link => format!("<a href=\"{}\">{}</a>", escape(link), escape(text)),
    };
    format!("<{open}{class}>{text}</{close}>")
}

/// The class attribute: alignment, a rule before a new group, and what the cell means.
fn classes(table: &Table, index: usize, align: Align, extra: &str) -> String {
    let group = |index: usize| {
        table
            .columns
            .get(index)
            .map(|column: &Column| &column.group)
    };
    let mut classes = Vec::new();
    if align == Align::Right {
        classes.push("number");
    }
    if index > 0 && group(index) != group(index - 1) {
        classes.push("first");
    }
    if !extra.is_empty() {
        classes.push(extra);
    }
    if classes.is_empty() {
        String::new()
    } else {
        format!(" class=\"{}\"", classes.join(" "))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::check;

    #[test]
    fn markup_in_text_is_only_text() {
        assert_eq!(
            escape("<i a='x'>\"&\u{0}"),
            "&lt;i a=&#39;x&#39;&gt;&quot;&amp; "
        );
        let page = page("</title><script>", &paragraph("</p><script>"));
        assert!(!page.contains("<script"));
        check::assert_balanced(&page);
    }

    #[test]
    fn a_table_has_pass_and_fail_in_word_and_class() {
        let columns = vec![
            Column::text("What"),
            Column::number("Value"),
            Column::text("Result"),
        ];
        let mut made = Table::new("Limits", columns);
        let verdicts = [true, false].map(|pass| Cell::verdict(pass, "pass", "FAIL"));
        for verdict in verdicts {
            made.rows.push(vec![
                Cell::text("a<b"),
                Cell::number(Some(0.25), 2),
                verdict,
            ]);
        }
        let html = table(&made);
        assert!(html.contains("<td class=\"number\">0.25</td><td class=\"pass\">pass</td>"));
        assert!(html.contains("<td class=\"fail\">FAIL</td>"));
        assert!(html.contains("<th scope=\"row\">a&lt;b</th>"));
    }

    #[test]
    fn a_cell_with_a_link_leads_there_and_is_text_all_the_same() {
        let mut made = Table::new("T", vec![Column::text("Machine")]);
        made.rows = vec![vec![Cell::text("a&b").to("machines/a%26b/\"report.html")]];
        let html = table(&made);
        let link = "<a href=\"machines/a%26b/&quot;report.html\">a&amp;b</a>";
        assert!(html.contains(link), "{html}");
        check::assert_balanced(&page("T", &html));
    }

    #[test]
    fn blocks_of_rows_are_set_apart() {
        let mut made = Table::new("T", vec![Column::text("Axis")]);
        made.rows = ["X", "X", "Y", "Y"]
            .map(|axis| vec![Cell::text(axis)])
            .to_vec();
        assert_eq!(table(&made).matches("<tr class=\"new\">").count(), 1);
        made.rows = ["a", "b", "c"].map(|name| vec![Cell::text(name)]).to_vec();
        assert_eq!(table(&made).matches("<tr class=\"new\">").count(), 0);
    }

    #[test]
    fn groups_span_their_columns() {
        let columns = vec![
            Column::text("Axis"),
            Column::number("1").under("Published"),
            Column::number("2").under("Published"),
        ];
        let mut made = Table::new("T", columns);
        made.rows.push(vec![Cell::text("X")]);
        let html = table(&made);
        let spans = "<td colspan=\"1\"></td>\
            <th scope=\"colgroup\" colspan=\"2\" class=\"first\">Published</th>";
        assert!(html.contains(spans), "{html}");
        assert_eq!(
            html.matches("<td class=\"number").count(),
            2,
            "a short row is filled"
        );
    }

    #[test]
    fn a_table_without_rows_is_a_sentence() {
        let html = table(&Table::new("Week", vec![Column::text("Day")]));
        assert!(html.contains("Not run.") && !html.contains("<table"));
    }
}
