//! The terminal view.
//!
//! In: the shared model and keys. Out: a screen that is drawn ten times a second at most, and only
//! when something has changed. The terminal is as it was before when this ends, whatever ended it.
//!
//! Left out: reading of frames, which goes on in its own thread however slow the terminal is.

mod chart;
mod draw;
mod keys;
mod picture;
mod screen;

use std::io;
use std::mem::ManuallyDrop;
use std::time::{Duration, Instant};

use ratatui::DefaultTerminal;
use ratatui::crossterm::event::{Event, KeyCode, KeyEventKind, KeyModifiers};

use super::reading::Shared;
use keys::Keys;
use picture::Picture;
use screen::{Action, Key, Screen};

/// The least time from one drawing to the next.
const DRAW: Duration = Duration::from_millis(100);

/// A screen on which nothing happens is drawn so often: ages go on.
const DRAW_ANYWAY: Duration = Duration::from_secs(1);

/// What the view needs besides.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// When it ends by itself.
    pub until: Option<Instant>,
    /// The address of the web page, where there is one.
    pub page: Option<String>,
}

/// Shows the model until the user has enough, the time is over, or the reader has ended.
///
/// A terminal that is closed is an end that the user has asked for.
///
/// Errors: what the terminal reports.
pub fn run(shared: &Shared, options: &Options) -> io::Result<()> {
    let mut terminal = ratatui::try_init()?;
    let shown = show(&mut terminal, shared, options);
    let restored = ratatui::try_restore();
    match shown.and(restored) {
        Err(error) if is_gone(&error) => {
            // Its end would show the cursor, and panic since it can't.
            let _ = ManuallyDrop::new(terminal);
            Ok(())
        }
        other => other,
    }
}

fn show(terminal: &mut DefaultTerminal, shared: &Shared, options: &Options) -> io::Result<()> {
    let colours = std::env::var_os("NO_COLOR").is_none_or(|value| value.is_empty());
    let mut screen = Screen::new(colours, options.page.clone());
    let mut picture = Picture::take(shared, &screen);
    let (mut drawn_at, mut drawn_frames) = (None::<Instant>, 0);
    let mut changed = true;
    let keys = Keys::read();
    while !shared.is_done()
        && !shared.is_stopped()
        && options.until.is_none_or(|until| Instant::now() < until)
    {
        let age = drawn_at.map_or(DRAW_ANYWAY, |at| at.elapsed());
        if age >= DRAW {
            if !screen.is_paused() {
                let frames = shared.model().frames();
                changed |= frames != drawn_frames || age >= DRAW_ANYWAY;
                if changed {
                    picture = Picture::take(shared, &screen);
                    drawn_frames = frames;
                }
            }
            if changed {
                terminal.draw(|frame| draw::draw(frame, &picture, &screen))?;
                changed = false;
                drawn_at = Some(Instant::now());
            }
        }
        let Some(event) = keys.next(DRAW)? else {
            continue;
        };
        changed = true;
        match handle(&event, &mut screen, shared) {
            Action::Quit => break,
            // A paused view keeps its moment, and takes no other events than it has.
            Action::Pause => shared.pause(screen.is_paused()),
            Action::Other => drawn_at = None,
        }
    }
    Ok(())
}

fn handle(event: &Event, screen: &mut Screen, shared: &Shared) -> Action {
    let Event::Key(pressed) = event else {
        return Action::Other;
    };
    if pressed.kind == KeyEventKind::Release {
        return Action::Other;
    }
    let control = pressed.modifiers.contains(KeyModifiers::CONTROL);
    let key = match pressed.code {
        KeyCode::Char('c') if control => Key::Char('q'),
        KeyCode::Char(letter) => Key::Char(letter),
        KeyCode::Tab | KeyCode::Right => Key::Next,
        KeyCode::BackTab | KeyCode::Left => Key::Before,
        KeyCode::Up => Key::Up,
        KeyCode::Down => Key::Down,
        KeyCode::PageUp => Key::PageUp,
        KeyCode::PageDown => Key::PageDown,
        KeyCode::Esc => Key::Escape,
        _ => return Action::Other,
    };
    let instruments = shared.model().instruments();
    screen.press(key, instruments)
}

/// Whether this is what the system reports of a terminal that was closed: EIO, which is 5
/// wherever there are such terminals, or ENXIO.
pub fn is_gone(error: &io::Error) -> bool {
    cfg!(unix) && matches!(error.raw_os_error(), Some(5 | 6))
}
