//! Axis ranges and round tick values.
//!
//! In: the values that must be seen. Out: a range that holds them and ticks at 1, 2 or 5 times a
//! power of ten inside it, with labels that have just enough decimals. Values are finite and not
//! beyond [`GREATEST`]; the caller treats others as gaps.

/// More ticks than this are never made.
const MOST: usize = 24;

/// Values beyond this are not drawn; it keeps every sum and product here finite.
pub const GREATEST: f64 = 1e12;

/// Whether a value can be placed on an axis.
pub fn drawable(value: f64) -> bool {
    value.abs() <= GREATEST
}

/// A range of an axis, `from < to`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Range {
    /// Left or lower end.
    pub from: f64,
    /// Right or upper end.
    pub to: f64,
}

impl Range {
    /// The least range that holds all drawable values; `None` when there is none.
    pub fn of(values: impl IntoIterator<Item = f64>) -> Option<Self> {
        let values = values.into_iter().filter(|value| drawable(*value));
        values.fold(None, |range: Option<Self>, value| match range {
            None => Some(Self {
                from: value,
                to: value,
            }),
            Some(Self { from, to }) => Some(Self {
                from: from.min(value),
                to: to.max(value),
            }),
        })
    }

    /// The least range that holds both.
    pub fn join(self, other: Self) -> Self {
        Self {
            from: self.from.min(other.from),
            to: self.to.max(other.to),
        }
    }

    /// The same range, or a wider one about its middle where it is too narrow to draw.
    pub fn widened(self) -> Self {
        let least = 1e-6_f64.max(1e-9 * self.from.abs().max(self.to.abs()));
        if self.to - self.from >= least {
            return self;
        }
        let half = 0.5_f64.max(0.1 * self.from.abs());
        Self {
            from: self.from - half,
            to: self.to + half,
        }
    }

    /// The range extended to the next multiples of `step` outside it.
    pub fn to_multiples(self, step: f64) -> Self {
        let (from, to) = (
            (self.from / step).floor() * step,
            (self.to / step).ceil() * step,
        );
        Self { from, to }
    }

    /// Where a value lies, 0 at `from` and 1 at `to`.
    pub fn share(self, value: f64) -> f64 {
        (value - self.from) / (self.to - self.from)
    }
}

/// A tick: where, and its label.
#[derive(Clone, Debug, PartialEq)]
pub struct Tick {
    /// Value on the axis.
    pub at: f64,
    /// Its label.
    pub label: String,
}

/// Ticks at the multiples of `step` inside the range, at most [`MOST`] of them.
pub fn ticks(range: Range, step: f64) -> Vec<Tick> {
    let first = (range.from / step - 1e-6).ceil();
    (0..MOST)
        .map(|index| (first + index as f64) * step)
        .take_while(|at| *at <= range.to + 1e-6 * step)
        .map(|at| Tick {
            at,
            label: label(at, step),
        })
        .collect()
}

/// The step of 1, 2 or 5 times a power of ten that gives about `wanted` ticks.
pub fn nice_step(range: Range, wanted: usize) -> f64 {
    let rough = (range.to - range.from) / wanted.max(2) as f64;
    let power = 10_f64.powf(rough.log10().floor());
    let times = match rough / power {
        times if times <= 1.0 => 1.0,
        times if times <= 2.0 => 2.0,
        times if times <= 5.0 => 5.0,
        _ => 10.0,
    };
    times * power
}

/// The value with as many decimals as the step needs, a true minus sign and no minus before 0.
fn label(value: f64, step: f64) -> String {
    let decimals = (-(step * 1.000_001).log10().floor()).clamp(0.0, 9.0) as usize;
    crate::table::format_number(Some(value), decimals).replace('-', "\u{2212}")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labels(from: f64, to: f64, wanted: usize) -> Vec<String> {
        let range = Range { from, to };
        ticks(range, nice_step(range, wanted))
            .into_iter()
            .map(|tick| tick.label)
            .collect()
    }

    #[test]
    fn steps_are_one_two_or_five() {
        assert_eq!(
            labels(0.0, 1.0, 5),
            ["0.0", "0.2", "0.4", "0.6", "0.8", "1.0"]
        );
        assert_eq!(labels(-0.2, 0.2, 4), ["−0.2", "−0.1", "0.0", "0.1", "0.2"]);
        assert_eq!(labels(0.0, 10_800.0, 4), ["0", "5000", "10000"]);
        assert_eq!(labels(1.0, 7.0, 7), ["1", "2", "3", "4", "5", "6", "7"]);
        assert_eq!(labels(0.0, 0.003, 3), ["0.000", "0.001", "0.002", "0.003"]);
    }

    #[test]
    fn ticks_lie_inside_and_are_bounded_for_any_range() {
        let ends: [f64; 9] = [-1e12, -90.0, -1e-7, 0.0, 3e-9, 0.4, 89.999_999, 1e6, 1e12];
        for from in ends {
            for to in ends {
                let range = Range {
                    from: from.min(to),
                    to: to.max(from),
                }
                .widened();
                let ticks = ticks(range, nice_step(range, 5));
                assert!((2..=10).contains(&ticks.len()), "{range:?} {ticks:?}");
                let slack = 1e-5 * (range.to - range.from);
                let inside = |t: &Tick| t.at >= range.from - slack && t.at <= range.to + slack;
                assert!(ticks.iter().all(inside), "{range:?} {ticks:?}");
            }
        }
    }

    #[test]
    fn a_range_holds_its_values_and_grows_to_ticks() {
        let range = Range::of([0.3, f64::NAN, -0.11, 1e13]).unwrap();
        assert_eq!(
            range,
            Range {
                from: -0.11,
                to: 0.3
            }
        );
        let wide = range.to_multiples(nice_step(range, 5));
        assert!(
            (wide.from + 0.2).abs() < 1e-12 && (wide.to - 0.3).abs() < 1e-12,
            "{wide:?}"
        );
        assert_eq!(Range::of([f64::INFINITY]), None);
    }

    #[test]
    fn a_constant_gets_a_range_around_it() {
        let range = Range {
            from: 45.0,
            to: 45.0,
        }
        .widened();
        assert_eq!(
            range,
            Range {
                from: 40.5,
                to: 49.5
            }
        );
        assert_eq!(range.share(45.0), 0.5);
    }
}
