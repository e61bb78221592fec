//! Which functions the instructions of a sample and of a SYNC are in.
//!
//! In: what was counted while nothing but samples came, and while SYNCs came too. Out: instructions
//! by function and by crate, those of interrupts without the wait for SPI.
//!
//! What is counted by address is not told apart by interrupt and background. So functions that
//! belong to the background are left out by their names; what it takes of others, such as copying,
//! is the difference to the count by interrupts, and stands by itself.

use super::Span;

/// Functions of the background, by the begin of their names: the idle loop, and the check sum of
/// the running program with its reads of the flash.
const BACKGROUND: [&str; 7] = [
    "app::app::idle",
    "app_dynamic::app::idle",
    "main",
    "flash::check_sum::",
    "flash::image::",
    "flash::access::",
    "firmware::chip::nor::",
];

/// Crates that the page names.
const CRATES: [&str; 5] = ["device", "firmware", "tilt", "canopen", "flash"];
/// What is in no crate of ours: the library, copying, and code that the linker has put together.
const OTHERS: &str = "others";
/// What the background takes of functions that interrupts use too, to be taken off.
pub const SHARED: &str = "less the background's part of these";

/// Instructions of something, function by function.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Share {
    /// All of them, by the count of interrupts.
    pub whole: f64,
    /// Functions with their instructions, the most first.
    pub functions: Vec<(String, f64)>,
}

impl Share {
    /// What `count` of each function gives, of those with any.
    fn of(whole: f64, functions: impl Iterator<Item = (String, f64)>) -> Self {
        let functions = functions.filter(|(_, count)| count.abs() >= 0.05);
        let mut functions: Vec<_> = functions.collect();
        functions.sort_by(|a, b| b.1.total_cmp(&a.1).then_with(|| a.0.cmp(&b.0)));
        Self { whole, functions }
    }

    /// Summed up by crate: those of ours, the others, and what is to be taken off for the whole.
    pub fn crates(&self) -> Vec<(&'static str, f64)> {
        let sum = |of: &str| {
            let functions = self.functions.iter();
            let functions = functions.filter(|(name, _)| crate_of(name) == of);
            functions.map(|(_, count)| count).sum::<f64>()
        };
        let crates = CRATES.into_iter().chain([OTHERS]);
        let mut rows: Vec<_> = crates.map(|name| (name, sum(name))).collect();
        let named: f64 = rows.iter().map(|(_, count)| count).sum();
        rows.push((SHARED, named - self.whole));
        rows
    }
}

/// Of a sample, and of a SYNC with what it brings.
pub fn shares(still: &Span, synced: &Span, syncs: u32) -> [Share; 2] {
    let sample = |count: u64| count as f64 / still.samples as f64;
    let functions = still.functions.iter();
    let functions = functions.map(|(name, count)| (name.clone(), sample(*count)));
    let whole = still.own() / still.samples as f64;
    let samples = Share::of(whole, functions);
    // A function that runs at samples only is in both, and nothing is left of it.
    let functions = synced.functions.iter().map(|(name, count)| {
        let still = still.functions.get(name).copied().unwrap_or_default();
        let besides = *count as f64 - sample(still) * synced.samples as f64;
        (name.clone(), besides / f64::from(syncs))
    });
    [samples, Share::of(synced.each(whole, syncs), functions)]
}

/// Whether a function is the background's.
pub fn is_background(name: &str) -> bool {
    let path = path(name);
    BACKGROUND.iter().any(|begin| match begin.contains("::") {
        true => path.starts_with(begin),
        false => path == *begin,
    })
}

/// Whether a function is in one of these modules, each with `::` at its end.
pub fn is_in(name: &str, modules: &[&str]) -> bool {
    let path = path(name);
    modules.iter().any(|module| path.starts_with(module))
}

/// Instructions of a span in the functions whose names are wanted.
pub fn sum_of(span: &Span, wanted: impl Fn(&str) -> bool) -> f64 {
    let functions = span.functions.iter();
    let wanted = functions.filter(|(name, _)| wanted(name));
    wanted.map(|(_, count)| *count as f64).sum()
}

/// A name from the begin of the first path in it.
fn path(name: &str) -> &str {
    let name = name.trim_start_matches(['<', '&', '[', '(']);
    name.strip_prefix("mut ").unwrap_or(name)
}

/// The crate that a function is counted for. What was built into its caller counts there.
fn crate_of(name: &str) -> &'static str {
    let first = path(name).split("::").next().unwrap_or_default();
    // The application's tasks: their entries are called as their interrupts are.
    let is_entry = |c: char| c.is_ascii_uppercase() || c.is_ascii_digit() || c == '_';
    let is_entry = name.chars().all(is_entry) && !name.starts_with("OUTLINED");
    let first = match first {
        "app" | "app_dynamic" => "firmware",
        _ if is_entry => "firmware",
        first => first,
    };
    let ours = CRATES.into_iter().find(|ours| *ours == first);
    ours.unwrap_or(OTHERS)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn span(own: u64, samples: u64, functions: &[(&str, u64)]) -> Span {
        let functions = functions.iter();
        Span {
            handlers: own,
            samples,
            functions: functions.map(|(name, n)| ((*name).into(), *n)).collect(),
            ..Span::default()
        }
    }

    #[test]
    fn a_sync_is_what_comes_on_top_of_the_samples() {
        let still = span(1000, 10, &[("tilt::step", 900), ("memset", 200)]);
        let functions = [
            ("tilt::step", 1800),
            ("memset", 500),
            ("canopen::pdo", 3000),
        ];
        let synced = span(5000, 20, &functions);
        let [sample, sync] = shares(&still, &synced, 10);
        let names = |share: &Share| share.functions.clone();
        assert_eq!(sample.whole, 100.0);
        let expected = [("tilt::step".into(), 90.0), ("memset".into(), 20.0)];
        assert_eq!(names(&sample), expected);
        assert_eq!(sync.whole, 300.0);
        let expected = [("canopen::pdo".into(), 300.0), ("memset".into(), 10.0)];
        assert_eq!(names(&sync), expected);
        assert_eq!(sample.crates()[2], ("tilt", 90.0));
        let rest = [(OTHERS, 20.0), (SHARED, 10.0)];
        assert_eq!(sample.crates()[5..], rest);
    }

    #[test]
    fn a_function_counts_for_the_crate_of_its_path() {
        for (name, of) in [
            ("TIM3", "firmware"),
            (
                "<firmware::chip::spi::Sensor<CS> as embedded_hal::spi::SpiDevice>::transaction",
                "firmware",
            ),
            ("app::app::task", "firmware"),
            ("<&mut tilt::filter::LowPass>::step", "tilt"),
            ("core::result::Result<T,E>::map", OTHERS),
            ("OUTLINED_FUNCTION_9", OTHERS),
            ("__aeabi_memcpy", OTHERS),
        ] {
            assert_eq!(crate_of(name), of, "{name}");
        }
    }

    #[test]
    fn the_check_sum_of_the_program_is_the_backgrounds() {
        for name in ["app::app::idle", "flash::check_sum::Crc32::add", "main"] {
            assert!(is_background(name), "{name}");
        }
        for name in ["app::app::task", "device::device::Device::poll", "maintain"] {
            assert!(!is_background(name), "{name}");
        }
    }
}
