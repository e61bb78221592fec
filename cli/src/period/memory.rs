//! What nodes remember, as part of a report.
//!
//! In: decoded fault logs and boxes (`blackbox`). Out: [`MemoryReport`]s and their table.

use super::data::MemoryReport;
use crate::text_table::{Cell, Column, Table};

/// The entries of a fault log.
pub fn entries(memory: &MemoryReport) -> Table {
    let columns = vec![
        Column::number("Since the start, s"),
        Column::number("SYNC"),
        Column::text("What"),
        Column::text("Code"),
        Column::text("State of the pair"),
        Column::text("Blamed"),
        Column::text("Why"),
        Column::number("Again"),
        Column::number("Box"),
    ];
    let mut table = Table::new("Fault log, newest first", columns);
    for entry in &memory.entries {
        let word = |text: &Option<String>| Cell::text(text.clone().unwrap_or_default());
        table.rows.push(vec![
            Cell::number(Some(entry.since_start_s), 3),
            Cell::text(entry.sync_count.to_string()),
            Cell::text(entry.text.as_str()),
            Cell::text(entry.code.as_str()),
            Cell::text(entry.state_text.as_str()),
            word(&entry.blamed),
            word(&entry.reason_text),
            Cell::text(if entry.repeats > 0 {
                entry.repeats.to_string()
            } else {
                String::new()
            }),
            Cell::text(
                entry
                    .box_number
                    .map_or(String::new(), |number| number.to_string()),
            ),
        ]);
    }
    table
}
