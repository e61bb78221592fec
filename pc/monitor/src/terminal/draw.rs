//! How the screen looks.
//!
//! In: a picture and what the user has chosen. Out: it is drawn. It fits into 80 columns and 24
//! lines; what is larger goes to the charts and the events. Words carry the meaning, colours only
//! repeat it.

use ratatui::Frame;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::{Color, Modifier, Style};
use ratatui::text::{Line, Span};
use ratatui::widgets::{Block, Clear, Paragraph, Wrap};

use super::super::clock::clock;
use super::super::level::Level;
use super::super::plain::{degrees, level, motion, told, unreadable, verdict};
use super::super::snapshot::{Bus, Channel, Compared, Instrument, SourceState};
use super::chart;
use super::picture::Picture;
use super::screen::{Over, Screen};
use output::printable;

const HELP: [&str; 12] = [
    "q          end",
    "p          stand still, and go on; recording goes on",
    "x, y       axis of the charts",
    "+, -       longer or shorter span of time",
    "tab, arrow next instrument",
    "l          list of events, up and down scroll",
    "?          this list",
    "",
    "The band is the expanded uncertainty (k = 2) of the difference:",
    "19 of 20 readings of a sound pair are within. The verdict is the nodes'.",
    "An outdated value is never shown as a number; a line gives the reason.",
    "",
];

/// Draws everything.
pub fn draw(frame: &mut Frame, picture: &Picture, screen: &Screen) {
    let parts = Layout::vertical([
        Constraint::Length(2),
        Constraint::Length(5),
        Constraint::Length(3),
        Constraint::Fill(3),
        Constraint::Length(4),
        Constraint::Length(1),
    ]);
    let [head, values, notes, charts, events, foot] = parts.areas(frame.area());
    frame.render_widget(Paragraph::new(header(picture, screen)), head);
    if let Some(instrument) = picture.snapshot.instruments.get(screen.instrument) {
        let lines = table(picture, instrument, screen);
        frame.render_widget(Paragraph::new(lines), values);
        let lines = reasons(&picture.snapshot.bus, instrument, screen);
        frame.render_widget(Paragraph::new(lines).wrap(Wrap { trim: false }), notes);
    }
    if charts.height > 0 {
        chart::draw(frame, charts, picture, screen);
    }
    latest(frame, events, picture, screen);
    frame.render_widget(Paragraph::new(keys(screen)), foot);
    match screen.over {
        Over::Nothing => {}
        Over::Help => help(frame),
        Over::Log => log(frame, picture, screen),
    }
}

fn colour(of: Level) -> Color {
    match of {
        Level::Good => Color::Green,
        Level::Unknown => Color::Gray,
        Level::Warning => Color::Yellow,
        Level::Fault => Color::Red,
    }
}

fn toned(text: String, of: Level, screen: &Screen) -> Span<'static> {
    let style = if screen.colours {
        Style::default().fg(colour(of))
    } else {
        Style::default()
    };
    Span::styled(text, style)
}

fn header(picture: &Picture, screen: &Screen) -> Vec<Line<'static>> {
    let snapshot = &picture.snapshot;
    let bus = &snapshot.bus;
    let bold = Style::default().add_modifier(Modifier::BOLD);
    let mut first = vec![
        Span::styled("plumb monitor ", bold),
        Span::raw(printable(&bus.name)),
        Span::raw(format!("  {}", clock(snapshot.time_s))),
    ];
    if screen.is_paused() {
        let style = Style::default().add_modifier(Modifier::REVERSED);
        first.push(Span::raw("  "));
        first.push(Span::styled(" PAUSED ", style));
    }
    vec![Line::from(first), Line::from(rates(bus, screen))]
}

fn rates(bus: &Bus, screen: &Screen) -> Vec<Span<'static>> {
    let load = match (bus.load_percent, bus.bit_rate_per_s) {
        (Some(percent), Some(rate)) => format!("{percent:.1} % of {} kbit/s", rate / 1000),
        _ => format!("{:.1} kbit/s", bus.bits_per_s as f64 / 1000.0),
    };
    let (frames, syncs) = (bus.frames_per_s, bus.syncs_per_s);
    let mut spans = vec![Span::raw(format!(
        "{frames} frames/s, {load}, SYNC {syncs}/s"
    ))];
    if bus.malformed > 0 {
        let text = format!(", {} malformed", bus.malformed);
        spans.push(toned(text, Level::Warning, screen));
    }
    if bus.unreadable > 0 {
        let text = format!(", {}", unreadable(bus.unreadable));
        spans.push(toned(text, Level::Warning, screen));
    }
    if bus.others > 0 {
        spans.push(Span::raw(format!(", {} of others", bus.others)));
    }
    match (&bus.recording, &bus.recording_reason) {
        (_, Some(_)) => spans.push(toned(", RECORDING ENDED".to_owned(), Level::Fault, screen)),
        (Some(_), None) => spans.push(Span::raw(format!(", recorded {}", bus.recorded))),
        _ => {}
    }
    spans
}

fn table(picture: &Picture, instrument: &Instrument, screen: &Screen) -> Vec<Line<'static>> {
    let bold = Style::default().add_modifier(Modifier::BOLD);
    let count = picture.snapshot.instruments.len();
    let mut first = Vec::new();
    if count > 1 {
        let text = format!("instrument {} of {count}: ", instrument.number);
        first.push(Span::raw(text));
    }
    let judged = toned(verdict(instrument), instrument.verdict.level, screen);
    first.push(judged.patch_style(bold));
    let head = format!(
        "{:4}{:>10}{:>11}{:>9}{:>7}{:>5}  {}",
        "", "X deg", "Y deg", "k=2 deg", "degC", "node", "state and validity"
    );
    let [a, b] = &instrument.channels;
    vec![
        Line::from(first),
        Line::from(Span::styled(head, bold)),
        channel(a, screen),
        channel(b, screen),
        difference(instrument, screen),
    ]
}

fn channel(channel: &Channel, screen: &Screen) -> Line<'static> {
    let uncertainty = number(channel.uncertainty_deg, 3);
    let temperature = channel
        .temperature_degc
        .map_or_else(|| "--".to_owned(), |degc| degc.to_string());
    let values = format!(
        "{:4}{:>10}{:>11}{uncertainty:>9}{temperature:>7}{:>5}  ",
        channel.name,
        degrees(channel.slope_x_deg),
        degrees(channel.slope_y_deg),
        channel.node_id,
    );
    let (of, words) = node(channel);
    Line::from(vec![Span::raw(values), toned(words, of, screen)])
}

fn node(channel: &Channel) -> (Level, String) {
    if channel.heartbeat_lost {
        return (Level::Fault, "HEARTBEAT LOST".to_owned());
    }
    let Some(state) = &channel.nmt else {
        return (Level::Unknown, "no heartbeat yet".to_owned());
    };
    let validity = channel.validity_text.as_deref().unwrap_or("stale");
    let of = match channel.validity {
        None => Level::Unknown,
        Some(bits) if bits & 3 != 3 || bits & 0x80 != 0 => Level::Fault,
        Some(_) => Level::Good,
    };
    // There is room for one of them: that a node is operational is worth a word while all is well.
    if of == Level::Good || state != "operational" {
        return (of, format!("{state}, {validity}"));
    }
    (of, validity.to_owned())
}

fn number(value: Option<f64>, places: usize) -> String {
    value.map_or_else(|| "--".to_owned(), |value| format!("{value:.places$}"))
}

fn difference(instrument: &Instrument, screen: &Screen) -> Line<'static> {
    let values = format!(
        "A-B {:>10}{:>11}{:>9}",
        degrees(instrument.difference_x_deg),
        degrees(instrument.difference_y_deg),
        number(instrument.band_deg, 3),
    );
    let (of, words) = match instrument.inside_band {
        Some(true) => (Level::Good, "inside its band"),
        Some(false) => (Level::Warning, "beyond, as 1 of 20 is"),
        None => (Level::Unknown, ""),
    };
    let slopes = match (instrument.difference_of, instrument.inside_band) {
        (Compared::Slopes, Some(_)) => " (slopes)",
        _ => "",
    };
    let words = toned(format!("{:14}{words}{slopes}", ""), of, screen);
    Line::from(vec![Span::raw(values), words])
}

/// Why something is not there, and which faults stand.
fn reasons(bus: &Bus, instrument: &Instrument, screen: &Screen) -> Vec<Line<'static>> {
    let mut lines = Vec::new();
    if let Some(text) = &bus.state_text
        && bus.state != SourceState::Running
    {
        let of = match bus.state {
            SourceState::Lost => Level::Fault,
            SourceState::Ended => Level::Good,
            _ => Level::Warning,
        };
        lines.push(Line::from(toned(printable(text), of, screen)));
    }
    for channel in &instrument.channels {
        let faults: Vec<_> = channel.faults.iter().map(|fault| fault.text).collect();
        if !faults.is_empty() {
            let text = format!("{} faults: {}", channel.name, faults.join("; "));
            lines.push(Line::from(toned(text, Level::Fault, screen)));
        }
        if let Some(text) = missing(channel) {
            lines.push(Line::from(toned(text, Level::Unknown, screen)));
        }
        let motion = motion(channel);
        if !motion.is_empty() {
            lines.push(Line::from(format!("{}{motion}", channel.name)));
        }
    }
    for channel in &instrument.channels {
        let found: Vec<_> = channel
            .findings
            .iter()
            .map(|f| format!("{} {}", f.count, f.text))
            .collect();
        if !found.is_empty() {
            let text = format!("{} seen: {}", channel.name, found.join("; "));
            lines.push(Line::from(toned(text, Level::Warning, screen)));
        }
    }
    lines
}

fn missing(channel: &Channel) -> Option<String> {
    let name = channel.name;
    match (&channel.slope_x_reason, &channel.slope_y_reason) {
        (Some(x), Some(y)) if x == y => Some(format!("{name} no angle: {x}")),
        (Some(x), Some(y)) => Some(format!("{name} no X: {x}; no Y: {y}")),
        (Some(x), None) => Some(format!("{name} no X: {x}")),
        (None, Some(y)) => Some(format!("{name} no Y: {y}")),
        (None, None) => None,
    }
}

fn latest(frame: &mut Frame, area: Rect, picture: &Picture, screen: &Screen) {
    let block = Block::new()
        .borders(ratatui::widgets::Borders::TOP)
        .title(" events ");
    let room = usize::from(block.inner(area).height);
    let first = picture.events.len().saturating_sub(room);
    let lines: Vec<_> = picture.events.iter().skip(first).collect();
    let lines: Vec<_> = lines.into_iter().map(|e| event(e, screen)).collect();
    frame.render_widget(Paragraph::new(lines).block(block), area);
}

fn event(of: &super::super::events::Event, screen: &Screen) -> Line<'static> {
    Line::from(vec![
        Span::raw(format!("{}  ", clock(of.time_s))),
        toned(format!("{:8}", level(of.level)), of.level, screen),
        Span::raw(told(of)),
    ])
}

fn keys(screen: &Screen) -> String {
    let keys = "q end  p pause  x/y axis  +/- span  tab instrument  l events  ? help";
    match &screen.page {
        Some(page) => format!("{keys}  {page}"),
        None => keys.to_owned(),
    }
}

fn help(frame: &mut Frame) {
    let area = middle(frame.area(), 70, HELP.len() as u16 + 2);
    let lines: Vec<_> = HELP.iter().map(|line| Line::from(*line)).collect();
    frame.render_widget(Clear, area);
    let block = Block::bordered().title(" keys ");
    frame.render_widget(Paragraph::new(lines).block(block), area);
}

fn middle(area: Rect, width: u16, height: u16) -> Rect {
    let (width, height) = (width.min(area.width), height.min(area.height));
    Rect {
        x: area.x + (area.width - width) / 2,
        y: area.y + (area.height - height) / 2,
        width,
        height,
    }
}

fn log(frame: &mut Frame, picture: &Picture, screen: &Screen) {
    let area = frame.area();
    let block =
        Block::bordered().title(format!(" events: {} kept, l closes ", picture.events.len()));
    let room = usize::from(block.inner(area).height);
    let most_back = picture.events.len().saturating_sub(room);
    let first = most_back - screen.back.min(most_back);
    let shown = picture.events.iter().skip(first).take(room);
    let lines: Vec<_> = shown.map(|one| event(one, screen)).collect();
    frame.render_widget(Clear, area);
    frame.render_widget(Paragraph::new(lines).block(block), area);
}

#[cfg(test)]
mod tests {
    use canopen::Frame as CanFrame;
    use ratatui::Terminal;
    use ratatui::backend::TestBackend;

    use super::super::super::model::{Model, Setup};
    use super::super::screen::Key;
    use super::*;
    use listen::Plan;

    const S: u64 = 1_000_000_000;

    /// A pair that agrees, for 20 s.
    fn model() -> Model {
        let setup = Setup {
            name: "socketcand://127.0.0.1:29536/plumb".to_owned(),
            bit_rate: Some(250_000),
        };
        let mut model = Model::new(&Plan::default(), setup);
        let start = 1_700_000_000 * S;
        for cycle in 0..2000 {
            let at = start + cycle * S / 100;
            let angle = ((cycle as f64 / 200.0).sin() * 1000.0) as i16;
            model.take(at, &CanFrame::data_frame(0x80, &[]));
            for node in [0, 1] {
                let [low, high] = (angle + node as i16).to_le_bytes();
                let bytes = [low, high, 5, 0, 0x7F, 1];
                model.take(at, &CanFrame::data_frame(0x181 + node, &bytes));
                if cycle % 10 == 0 {
                    let bytes = [0x7F, 1, 30, 0, 25, 10, 0, 24];
                    model.take(at, &CanFrame::data_frame(0x281 + node, &bytes));
                    model.take(at, &CanFrame::data_frame(0x701 + node, &[5]));
                }
            }
        }
        model
    }

    fn seen(model: &Model, screen: &Screen, width: u16, height: u16) -> String {
        let mut terminal = Terminal::new(TestBackend::new(width, height)).unwrap();
        let picture = Picture::of(model, screen);
        terminal
            .draw(|frame| draw(frame, &picture, screen))
            .unwrap();
        terminal.backend().to_string()
    }

    fn has(text: &str, wanted: &str) {
        assert!(text.contains(wanted), "no {wanted:?} in\n{text}");
    }

    #[test]
    fn everything_fits_into_80_columns_and_24_lines() {
        let text = seen(&model(), &Screen::new(false, None), 80, 24);
        for wanted in [
            "plumb monitor socketcand://127.0.0.1:29536/plumb  22:13:39.9",
            "ok: both agree",
            "A       -5.390     +0.050    0.060     24    1  operational, valid",
            "B       -5.380     +0.050    0.060     24    2  operational, valid",
            "A-B     -0.010     +0.000    0.085",
            "inside its band",
            "slope X, deg, last 60 s",
            "A-B in X, deg, and its band",
            "B: both agree",
            "q end  p pause",
        ] {
            has(&text, wanted);
        }
        assert!(text.contains('\u{2022}'), "no mark of B\n{text}");
    }

    #[test]
    fn what_is_stale_has_no_digits_and_a_reason() {
        let mut model = model();
        model.pass(model.now_ns() + 3 * S);
        let text = seen(&model, &Screen::new(true, None), 80, 24);
        has(&text, "A           --         --");
        has(&text, "A no angle: stale, 3.0 s old: its heartbeat is lost");
        has(&text, "HEARTBEAT LOST");
        has(&text, "nothing has come for 3 s");
        has(&text, "FAULT: no verdict");
    }

    #[test]
    fn a_fault_is_there_in_words_without_any_colour() {
        let mut model = model();
        let bytes = [0x08, 0xFF, 0x80, 0, 0x20, 0x20, 0x40 | 13, 7];
        let now_ns = model.now_ns();
        model.take(now_ns, &CanFrame::data_frame(0x082, &bytes));
        model.take(now_ns, &CanFrame::data_frame(0x181, &[0, 0, 0, 0, 0x7F, 8]));
        model.take(
            now_ns,
            &CanFrame::data_frame(0x182, &[0, 0x80, 0, 0x80, 0x7C, 7]),
        );
        let text = seen(&model, &Screen::new(false, None), 80, 24);
        has(&text, "FAULT: channel B is faulty");
        has(&text, "moved alone, or gravity of");
        has(
            &text,
            "B faults: this channel is faulty; this channel moved alone",
        );
        has(&text, "2  not valid");
    }

    #[test]
    fn help_and_log_lie_over_the_screen() {
        let mut screen = Screen::new(false, None);
        screen.press(Key::Char('?'), 1);
        has(&seen(&model(), &screen, 80, 24), "stand still, and go on");
        screen.press(Key::Char('l'), 1);
        screen.press(Key::PageUp, 1);
        let text = seen(&model(), &screen, 80, 24);
        has(&text, "events: 4 kept, l closes");
        has(&text, "A: the node is operational");
    }

    #[test]
    fn no_size_of_the_terminal_is_too_small_or_too_large() {
        let model = model();
        let mut screen = Screen::new(true, Some("http://127.0.0.1:8410/".to_owned()));
        for over in ['z', '?', 'l'] {
            screen.press(Key::Char(over), 1);
            for (width, height) in [(1, 1), (10, 3), (40, 12), (79, 23), (200, 60), (400, 5)] {
                seen(&model, &screen, width, height);
            }
        }
    }

    #[test]
    fn nothing_from_outside_upsets_the_terminal() {
        let setup = Setup {
            name: "a\u{1b}[2Jb".to_owned(),
            bit_rate: None,
        };
        let model = Model::new(&Plan::default(), setup);
        let text = seen(&model, &Screen::new(true, None), 80, 24);
        has(&text, "a\\u{1b}[2Jb");
        has(&text, "nothing was received yet");
        assert!(!text.contains('\u{1b}'));
    }
}
