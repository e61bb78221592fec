//! Progress bars that keep out of the way.
//!
//! In: a name and a number of steps per task, and how many are done. Out: one bar per task on
//! stderr, only when stderr is a terminal and only for a task that has run for a second; else
//! nothing at all. Tasks may be driven from several threads at a time. What the program prints as
//! its result goes to stdout and is none of this module's business.

use std::io::IsTerminal;
use std::sync::Once;
use std::time::{Duration, Instant};

use indicatif::{MultiProgress, ProgressBar, ProgressDrawTarget, ProgressStyle};

/// A task shorter than this shows no bar.
const QUIET_FOR: Duration = Duration::from_secs(1);

/// The bars of one command.
#[derive(Debug)]
pub struct Progress {
    bars: Option<MultiProgress>,
    quiet_for: Duration,
}

impl Progress {
    /// Bars on stderr when that is a terminal, else silence.
    pub fn on_stderr() -> Self {
        let target = std::io::stderr()
            .is_terminal()
            .then(ProgressDrawTarget::stderr);
        Self::on(target, QUIET_FOR)
    }

    /// Silence.
    pub fn hidden() -> Self {
        Self::on(None, QUIET_FOR)
    }

    fn on(target: Option<ProgressDrawTarget>, quiet_for: Duration) -> Self {
        Self {
            bars: target.map(MultiProgress::with_draw_target),
            quiet_for,
        }
    }

    /// A line on stderr, above the bars where there are any.
    pub fn say(&self, line: &str) {
        match &self.bars {
            Some(bars) => bars.suspend(|| eprintln!("{line}")),
            None => eprintln!("{line}"),
        }
    }

    /// Starts a task of `steps` steps. The bar goes away when the task is dropped.
    pub fn task(&self, name: &str, steps: u64) -> Task {
        let bars = self.bars.clone();
        let bar = ProgressBar::with_draw_target(Some(steps), ProgressDrawTarget::hidden());
        if bars.is_some() {
            bar.set_style(style());
            bar.set_prefix(name.to_owned());
        }
        let show_from = Instant::now().checked_add(self.quiet_for);
        Task {
            bars,
            bar,
            show_from,
            shown: Once::new(),
        }
    }
}

/// One bar: name, bar, share done, time left.
fn style() -> ProgressStyle {
    let plain =
        ProgressStyle::with_template("{prefix:28!} [{bar:30}] {percent:>3} % {eta:>4} left");
    plain
        .map(|style| style.progress_chars("=> "))
        .unwrap_or_else(|_| ProgressStyle::default_bar())
}

/// A task under way. It may be shared between threads; call it some hundred times per second at
/// most, not per sample.
#[derive(Debug)]
pub struct Task {
    bars: Option<MultiProgress>,
    bar: ProgressBar,
    show_from: Option<Instant>,
    shown: Once,
}

impl Task {
    /// Counts `steps` more steps as done.
    pub fn advance(&self, steps: u64) {
        let Some(bars) = &self.bars else { return };
        if self.show_from.is_some_and(|from| Instant::now() >= from) {
            // The bar keeps its own count while hidden, so it appears with the right share.
            self.shown.call_once(|| drop(bars.add(self.bar.clone())));
        }
        self.bar.inc(steps);
    }
}

impl Drop for Task {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
        if let (Some(bars), true) = (&self.bars, self.shown.is_completed()) {
            bars.remove(&self.bar);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io;
    use std::sync::{Arc, Mutex};

    /// A terminal that remembers what was written to it.
    #[derive(Clone, Debug, Default)]
    struct Screen(Arc<Mutex<String>>);

    impl Screen {
        fn text(&self) -> String {
            self.0.lock().unwrap().clone()
        }

        fn progress(&self, quiet_for: Duration) -> Progress {
            let target = ProgressDrawTarget::term_like_with_hz(Box::new(self.clone()), 255);
            Progress::on(Some(target), quiet_for)
        }
    }

    impl indicatif::TermLike for Screen {
        fn width(&self) -> u16 {
            100
        }
        fn move_cursor_up(&self, _: usize) -> io::Result<()> {
            Ok(())
        }
        fn move_cursor_down(&self, _: usize) -> io::Result<()> {
            Ok(())
        }
        fn move_cursor_right(&self, _: usize) -> io::Result<()> {
            Ok(())
        }
        fn move_cursor_left(&self, _: usize) -> io::Result<()> {
            Ok(())
        }
        fn write_line(&self, text: &str) -> io::Result<()> {
            self.write_str(text)
        }
        fn write_str(&self, text: &str) -> io::Result<()> {
            self.0.lock().unwrap().push_str(text);
            Ok(())
        }
        fn clear_line(&self) -> io::Result<()> {
            Ok(())
        }
        fn flush(&self) -> io::Result<()> {
            Ok(())
        }
    }

    #[test]
    fn a_quick_task_draws_nothing() {
        let screen = Screen::default();
        let progress = screen.progress(Duration::from_secs(3600));
        let task = progress.task("quick", 10);
        (0..10).for_each(|_| task.advance(1));
        drop(task);
        assert_eq!(screen.text(), "");
    }

    #[test]
    fn a_long_task_shows_its_name_and_share() {
        let screen = Screen::default();
        let progress = screen.progress(Duration::ZERO);
        let task = progress.task("Excavator week", 4);
        task.advance(1);
        std::thread::sleep(Duration::from_millis(20));
        task.advance(1);
        assert!(screen.text().contains("Excavator week"));
        assert!(screen.text().contains("50 %"), "{}", screen.text());
    }

    #[test]
    fn without_a_terminal_there_is_nothing() {
        let progress = Progress::hidden();
        let task = progress.task("quiet", 3);
        task.advance(3);
        assert!(!task.shown.is_completed());
    }

    #[test]
    fn two_threads_drive_a_bar_each() {
        let screen = Screen::default();
        let progress = screen.progress(Duration::ZERO);
        std::thread::scope(|scope| {
            for name in ["Paper mode", "Product mode"] {
                let task = progress.task(name, 100);
                scope.spawn(move || {
                    for _ in 0..20 {
                        task.advance(5);
                        std::thread::sleep(Duration::from_millis(1));
                    }
                });
            }
        });
        let text = screen.text();
        assert!(text.contains("Paper mode") && text.contains("Product mode"));
    }
}
