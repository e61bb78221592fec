//! Mean and scatter of the three axes in a window that moves along a recording.
//!
//! In: times and accelerations. Out: one [`Window`] per sample, centred on it. Windows are given
//! in time and not in samples: loggers jitter, and after a start they often hand out what had
//! piled up in a buffer at several times the true rate.

/// What stands in one window.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Window {
    /// Samples.
    pub count: usize,
    /// Mean of each axis, unit of the input.
    pub mean: [f64; 3],
    /// Standard deviation of each axis, unit of the input.
    pub std: [f64; 3],
}

impl Window {
    /// Standard deviation of the three axes together.
    pub fn scatter(&self) -> f64 {
        norm(self.std)
    }
}

/// Length of a vector.
pub fn norm(v: [f64; 3]) -> f64 {
    v.iter().map(|c| c * c).sum::<f64>().sqrt()
}

/// Running sums from which any range of samples is summed up at once.
pub struct Sums {
    sums: Vec<[[f64; 2]; 3]>,
}

impl Sums {
    /// Sums up from the start.
    pub fn new(accel: impl Iterator<Item = [f64; 3]>) -> Self {
        let mut total = [[0.0; 2]; 3];
        let mut sums = vec![total];
        for sample in accel {
            for (sum, value) in total.iter_mut().zip(sample) {
                *sum = [sum[0] + value, sum[1] + value * value];
            }
            sums.push(total);
        }
        Self { sums }
    }

    /// The samples `from..to` as one window; empty when there are none.
    pub fn window(&self, from: usize, to: usize) -> Window {
        let (Some(low), Some(high)) = (self.sums.get(from), self.sums.get(to)) else {
            return Window::default();
        };
        let count = to.saturating_sub(from);
        let n = count.max(1) as f64;
        let mut window = Window {
            count,
            ..Window::default()
        };
        for axis in 0..3 {
            let mean = (high[axis][0] - low[axis][0]) / n;
            let square = (high[axis][1] - low[axis][1]) / n;
            window.mean[axis] = mean;
            window.std[axis] = (square - mean * mean).max(0.0).sqrt();
        }
        window
    }
}

/// The window of each sample: all samples within `half_us` of it, before and after.
pub fn moving(times_us: &[u64], sums: &Sums, half_us: u64) -> Vec<Window> {
    let (mut from, mut to) = (0, 0);
    let mut windows = Vec::with_capacity(times_us.len());
    for &centre in times_us {
        while times_us
            .get(from)
            .is_some_and(|&t| t.saturating_add(half_us) < centre)
        {
            from += 1;
        }
        while times_us
            .get(to)
            .is_some_and(|&t| t <= centre.saturating_add(half_us))
        {
            to += 1;
        }
        windows.push(sums.window(from, to));
    }
    windows
}

/// The value below which the given share (0 to 1) of the values lies; `None` of no values.
pub fn quantile(mut values: Vec<f64>, share: f64) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    let last = values.len().checked_sub(1)?;
    values.get((last as f64 * share).round() as usize).copied()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_window_is_a_span_of_time() {
        let times = [0, 10, 20, 100, 110];
        let accel = [
            [1.0, 0.0, 0.0],
            [3.0, 0.0, 0.0],
            [5.0, 0.0, 0.0],
            [7.0; 3],
            [9.0; 3],
        ];
        let windows = moving(&times, &Sums::new(accel.into_iter()), 10);
        let counts: Vec<usize> = windows.iter().map(|w| w.count).collect();
        assert_eq!(counts, [2, 3, 2, 2, 2]);
        assert_eq!(windows[1].mean[0], 3.0);
        assert!((windows[1].std[0] - (8.0f64 / 3.0).sqrt()).abs() < 1e-12);
        assert!((windows[4].scatter() - 3.0f64.sqrt()).abs() < 1e-12);
    }

    #[test]
    fn quantiles() {
        assert_eq!(quantile(vec![], 0.5), None);
        assert_eq!(quantile(vec![3.0, 1.0, 2.0], 0.5), Some(2.0));
        assert_eq!(quantile(vec![3.0, 1.0, 2.0], 1.0), Some(3.0));
    }
}
