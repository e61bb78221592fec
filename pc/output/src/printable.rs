//! Text of others in a line of ours.
//!
//! In: names of files, lines of logs, whatever anybody has written. Out: one line that a terminal
//! shows as it is. Left out: HTML, which has its own rules (`html`).

/// The text with escapes for what would break its line or upset a terminal: control characters,
/// line separators, and marks that turn the direction of writing.
pub fn printable(text: &str) -> String {
    let mut line = String::with_capacity(text.len());
    for c in text.chars() {
        let turns = matches!(c, '\u{2028}'..='\u{202e}' | '\u{2066}'..='\u{2069}');
        if c.is_control() || turns {
            line.extend(c.escape_default());
        } else {
            line.push(c);
        }
    }
    line
}
