//! What the user has chosen to see.
//!
//! In: keys. Out: the instrument, the axis, the span of time, what lies over the screen, and
//! whether it stands still.
//!
//! Left out: how any of it looks.

/// Spans of time that can be chosen, s.
pub const SPANS_S: [u64; 4] = [10, 60, 600, 6000];

/// Lines by which a page scrolls.
const PAGE: usize = 10;

/// A key.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Key {
    /// A letter or a sign.
    Char(char),
    /// Tab, or the arrow to the right.
    Next,
    /// Tab back, or the arrow to the left.
    Before,
    /// The arrow up.
    Up,
    /// The arrow down.
    Down,
    /// A page up.
    PageUp,
    /// A page down.
    PageDown,
    /// Escape.
    Escape,
}

/// What a key asks for besides another screen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Action {
    /// The end.
    Quit,
    /// Stand still, or go on.
    Pause,
    /// Nothing but drawing.
    Other,
}

/// What lies over the screen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Over {
    /// Nothing.
    Nothing,
    /// The list of keys.
    Help,
    /// The list of events.
    Log,
}

/// The choices.
#[derive(Clone, Debug)]
pub struct Screen {
    /// The instrument, from 0 on.
    pub instrument: usize,
    /// The axis of the charts: 0 for X.
    pub axis: usize,
    /// What lies over it.
    pub over: Over,
    /// How far the list of events was scrolled back, in lines.
    pub back: usize,
    /// Whether colours may be used.
    pub colours: bool,
    /// The address of the web page.
    pub page: Option<String>,
    span: usize,
    paused: bool,
}

impl Screen {
    /// What is seen at first.
    pub const fn new(colours: bool, page: Option<String>) -> Self {
        Self {
            instrument: 0,
            axis: 0,
            over: Over::Nothing,
            back: 0,
            colours,
            page,
            span: 1,
            paused: false,
        }
    }

    /// The span of time, s.
    pub fn span_s(&self) -> u64 {
        SPANS_S.get(self.span).copied().unwrap_or(60)
    }

    /// Whether it stands still.
    pub const fn is_paused(&self) -> bool {
        self.paused
    }

    /// Takes a key, of a screen with so many instruments.
    pub fn press(&mut self, key: Key, instruments: usize) -> Action {
        let count = instruments.max(1);
        match key {
            Key::Char('q' | 'Q') => return Action::Quit,
            Key::Char('p' | ' ') => {
                self.paused = !self.paused;
                return Action::Pause;
            }
            Key::Char('l') => self.toggle(Over::Log),
            Key::Char('?' | 'h') => self.toggle(Over::Help),
            Key::Escape => self.over = Over::Nothing,
            Key::Char('x') => self.axis = 0,
            Key::Char('y') => self.axis = 1,
            Key::Char('+' | '=') => self.span = (self.span + 1).min(SPANS_S.len() - 1),
            Key::Char('-') => self.span = self.span.saturating_sub(1),
            Key::Next => self.instrument = (self.instrument + 1) % count,
            Key::Before => self.instrument = (self.instrument + count - 1) % count,
            Key::Up => self.back += 1,
            Key::PageUp => self.back += PAGE,
            Key::Down => self.back = self.back.saturating_sub(1),
            Key::PageDown => self.back = self.back.saturating_sub(PAGE),
            Key::Char(_) => {}
        }
        Action::Other
    }

    fn toggle(&mut self, over: Over) {
        self.back = 0;
        self.over = if self.over == over {
            Over::Nothing
        } else {
            over
        };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_choose_and_stay_within_bounds() {
        let mut screen = Screen::new(true, None);
        for _ in 0..9 {
            screen.press(Key::Char('+'), 1);
        }
        assert_eq!(screen.span_s(), 6000);
        for _ in 0..9 {
            screen.press(Key::Char('-'), 1);
        }
        assert_eq!(screen.span_s(), 10);
        screen.press(Key::Before, 3);
        assert_eq!(screen.instrument, 2);
        screen.press(Key::Next, 3);
        assert_eq!(screen.instrument, 0);
        screen.press(Key::Next, 0);
        screen.press(Key::Down, 1);
        assert_eq!((screen.instrument, screen.back), (0, 0));
        screen.press(Key::Char('y'), 1);
        assert_eq!(screen.axis, 1);
    }

    #[test]
    fn what_lies_over_the_screen_goes_by_the_same_key_and_by_escape() {
        let mut screen = Screen::new(true, None);
        screen.press(Key::Char('l'), 1);
        assert_eq!(screen.over, Over::Log);
        screen.press(Key::Char('?'), 1);
        assert_eq!(screen.over, Over::Help);
        screen.press(Key::Char('?'), 1);
        assert_eq!(screen.over, Over::Nothing);
        screen.press(Key::Char('l'), 1);
        screen.press(Key::Escape, 1);
        assert_eq!(screen.over, Over::Nothing);
    }

    #[test]
    fn pausing_and_the_end_are_for_the_caller() {
        let mut screen = Screen::new(true, None);
        assert_eq!(screen.press(Key::Char('p'), 1), Action::Pause);
        assert!(screen.is_paused());
        assert_eq!(screen.press(Key::Char('p'), 1), Action::Pause);
        assert!(!screen.is_paused());
        assert_eq!(screen.press(Key::Char('q'), 1), Action::Quit);
        assert_eq!(screen.press(Key::Char('z'), 1), Action::Other);
    }
}
