//! Running figures: root mean square, mean, largest; and the median of a list.
//!
//! In: errors one at a time, in any unit. Out: figures in the same unit. Nothing is stored but
//! sums, so a year of samples costs no more memory than a minute.

/// Running sums of one quantity.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Tally {
    count: u64,
    sum: f64,
    squares: f64,
    largest: f64,
}

impl Tally {
    /// Takes in one value.
    pub fn add(&mut self, value: f64) {
        self.count += 1;
        self.sum += value;
        self.squares += value * value;
        self.largest = self.largest.max(value.abs());
    }

    /// Takes in all of another tally.
    pub fn join(&mut self, other: &Self) {
        self.count += other.count;
        self.sum += other.sum;
        self.squares += other.squares;
        self.largest = self.largest.max(other.largest);
    }

    /// How many values.
    pub fn count(&self) -> u64 {
        self.count
    }

    /// Root mean square; 0 when empty.
    pub fn rms(&self) -> f64 {
        (self.squares / self.count.max(1) as f64).sqrt()
    }

    /// Mean; 0 when empty.
    pub fn mean(&self) -> f64 {
        self.sum / self.count.max(1) as f64
    }

    /// Largest size.
    pub fn largest(&self) -> f64 {
        self.largest
    }
}

/// The median; 0 for an empty list. Sorts in place.
pub fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    match values.len() {
        0 => 0.0,
        n if n % 2 == 1 => values[n / 2],
        n => 0.5 * (values[n / 2 - 1] + values[n / 2]),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tallies_add_up() {
        let mut all = Tally::default();
        let mut part = Tally::default();
        [3.0, -4.0].into_iter().for_each(|v| all.add(v));
        part.add(5.0);
        all.join(&part);
        assert_eq!((all.count(), all.largest()), (3, 5.0));
        assert!((all.rms() - (50.0f64 / 3.0).sqrt()).abs() < 1e-12);
        assert!((all.mean() - 4.0 / 3.0).abs() < 1e-12);
    }

    #[test]
    fn median_of_odd_even_and_none() {
        assert_eq!(median(&mut [3.0, 1.0, 2.0]), 2.0);
        assert_eq!(median(&mut [4.0, 1.0, 2.0, 3.0]), 2.5);
        assert_eq!(median(&mut []), 0.0);
    }
}
