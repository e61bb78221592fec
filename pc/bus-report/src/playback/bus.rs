//! What one interface of a log has shown.
//!
//! In: its frames. Out: a [`Bus`]: what `watch` knows, and extremes and means of the angles.

use canopen::Frame;

use listen::{Delta, Meaning, Plan, Watch};

/// Smallest, largest and mean of numbers in 0.001 deg.
#[derive(Clone, Copy, Debug, Default)]
pub struct Spread {
    /// How many.
    pub count: u64,
    /// The smallest.
    pub min: i32,
    /// The largest.
    pub max: i32,
    sum: i128,
    squares: i128,
}

impl Spread {
    /// Takes one in.
    #[inline]
    pub fn add(&mut self, value: i32) {
        if self.count == 0 {
            (self.min, self.max) = (value, value);
        }
        self.min = self.min.min(value);
        self.max = self.max.max(value);
        self.count += 1;
        let value = i64::from(value);
        self.sum += i128::from(value);
        self.squares += i128::from(value * value);
    }

    /// The mean; `None` of nothing.
    pub fn mean(&self) -> Option<f64> {
        (self.count > 0).then(|| self.sum as f64 / self.count as f64)
    }

    /// The root of the mean square; `None` of nothing.
    pub fn rms(&self) -> Option<f64> {
        (self.count > 0).then(|| (self.squares as f64 / self.count as f64).sqrt())
    }
}

/// One channel.
#[derive(Clone, Debug, Default)]
pub struct Channel {
    /// Slope X and Y where they may be used.
    pub slopes: [Spread; 2],
    /// TPDO 1 seen.
    pub readings: u64,
    /// How often each state of the pair was told; the last place is for those that do not exist.
    pub states: [u64; 11],
    /// Standard uncertainty.
    pub uncertainty: Spread,
    /// Temperature, degC.
    pub temperature: Spread,
    /// Every fault that an EMCY has told of.
    pub faults: u32,
    /// EMCY messages.
    pub emergencies: u64,
}

/// One instrument.
#[derive(Clone, Debug, Default)]
pub struct Instrument {
    /// Channel A and B.
    pub channels: [Channel; 2],
    /// Channel A minus channel B at the same SYNC.
    pub delta: [Spread; 2],
}

/// One interface.
#[derive(Clone, Debug)]
pub struct Bus {
    /// What is known of the instruments.
    pub watch: Watch,
    /// By the places of the plan.
    pub instruments: Vec<Instrument>,
    /// Time of the first frame, and the latest.
    pub span_ns: Option<[u64; 2]>,
}

impl Bus {
    /// Has seen nothing.
    pub fn new(plan: &Plan) -> Self {
        Self {
            watch: Watch::new(plan),
            instruments: vec![Instrument::default(); plan.pairs.len()],
            span_ns: None,
        }
    }

    /// Takes a frame.
    #[inline]
    pub fn take(&mut self, time_ns: u64, frame: &Frame) -> Meaning {
        let [_, latest] = self.span_ns.get_or_insert([time_ns; 2]);
        *latest = (*latest).max(time_ns);
        let news = self.watch.take(time_ns, frame);
        self.note(news);
        news
    }

    #[inline]
    fn note(&mut self, news: Meaning) {
        let (Meaning::Slopes(place, _) | Meaning::Detail(place) | Meaning::Emergency(place, _)) =
            news
        else {
            return;
        };
        let (pair, side) = (usize::from(place.pair), usize::from(place.side));
        let (Some(instrument), Some(known)) =
            (self.instruments.get_mut(pair), self.watch.pairs().get(pair))
        else {
            return;
        };
        if let Meaning::Slopes(_, Some(Delta { mdeg, .. })) = news {
            let both = instrument.delta.iter_mut().zip(mdeg);
            both.for_each(|(spread, mdeg)| mdeg.into_iter().for_each(|mdeg| spread.add(mdeg)));
        }
        let (Some(channel), Some(said)) =
            (instrument.channels.get_mut(side), known.sides.get(side))
        else {
            return;
        };
        match news {
            Meaning::Slopes(..) => channel.slopes(said.slopes.as_ref()),
            Meaning::Detail(_) => channel.detail(said.detail.as_ref()),
            Meaning::Emergency(..) => {
                channel.emergencies += 1;
                channel.faults |= said.faults;
            }
            _ => {}
        }
    }
}

impl Channel {
    fn slopes(&mut self, slopes: Option<&listen::Slopes>) {
        let Some(slopes) = slopes else { return };
        self.readings += 1;
        for (axis, (spread, mdeg)) in self.slopes.iter_mut().zip(slopes.mdeg).enumerate() {
            if slopes.validity & (1 << axis) != 0
                && let Some(mdeg) = mdeg
            {
                spread.add(mdeg);
            }
        }
        let state = usize::from(slopes.state).min(10);
        if let Some(count) = self.states.get_mut(state) {
            *count += 1;
        }
    }

    fn detail(&mut self, detail: Option<&listen::Detail>) {
        let Some(detail) = detail else { return };
        if let Some(mdeg) = detail.uncertainty_mdeg {
            self.uncertainty.add(i32::from(mdeg));
        }
        self.temperature.add(i32::from(detail.temperature_degc));
    }
}
