//! Work spread over two threads, with results in the order of the work.
//!
//! In: a count, and what to do for each number below it. Out: the results in the order of the
//! numbers, so that they don't depend on who did what.

use std::sync::atomic::{AtomicUsize, Ordering};

/// The results of `work` for 0 to `count` - 1.
pub fn spread<T: Send>(count: usize, work: impl Fn(usize) -> T + Sync) -> Vec<T> {
    let next = AtomicUsize::new(0);
    let worker = || {
        let mut done = Vec::new();
        loop {
            let number = next.fetch_add(1, Ordering::Relaxed);
            if number >= count {
                return done;
            }
            done.push((number, work(number)));
        }
    };
    let mut all = std::thread::scope(|scope| {
        let other = scope.spawn(worker);
        let mut all = worker();
        match other.join() {
            Ok(others) => all.extend(others),
            // A panic is a fault of this program, and half of the results would be a lie.
            Err(panic) => std::panic::resume_unwind(panic),
        }
        all
    });
    all.sort_by_key(|(number, _)| *number);
    all.into_iter().map(|(_, result)| result).collect()
}
