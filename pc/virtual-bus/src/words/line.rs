//! The lines that move and break the virtual instrument, one command each.
//!
//! In: a line of a script, or one that was typed or sent. Out: a [`Line`]: when, and what.
//! Everything that can be wrong with it is found here, before anything happens; what follows from
//! the lines before it (which pose, which time) is `script`'s to see. One table declares every
//! word; help, completion and the page of words are made of it.
//!
//! Left out: what can break in a node (`trouble`); what the words do (`world/effects`).

use std::ops::RangeInclusive;

use sim::network::guest::Switch;
use sim::network::hand::Pose;

use super::reader::{Nodes, Read, Reader, WordError, with_units};
use super::table::{Table, row};
use super::trouble::{FAULTS, NOTE, Trouble};

/// Bit rates of CiA 301, kbit/s.
pub const BIT_RATES: [u16; 8] = [10, 20, 50, 125, 250, 500, 800, 1000];

/// Temperatures of the air that the chamber can make, degC.
pub const AIR_DEGC: RangeInclusive<f64> = -40.0..=85.0;

/// What the wires of the bus do.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum BusTrouble {
    /// Held dominant for so many seconds.
    Short(f64),
    /// This share of the frames is disturbed, flagged and repeated.
    Noise(f64),
    /// This share of the frames is missed by one receiver, and nobody learns of it.
    Loss(f64),
    /// This share of the frames comes twice.
    Double(f64),
    /// All well again.
    Heal,
}

/// One command.
#[derive(Clone, Debug, PartialEq)]
pub enum Word {
    /// Slope Y goes there, degrees.
    Pitch(f64),
    /// Slope X goes there, degrees.
    Roll(f64),
    /// Both slopes go to zero.
    Level,
    /// Speed of the next turns, deg/s.
    Rate(f64),
    /// Vibration, g rms.
    Vibration(f64),
    /// The chamber goes to so many degC; true: at once, and the parts with it.
    Temperature(f64, bool),
    /// Something breaks in these nodes.
    Fault(Nodes, Trouble),
    /// What was broken in these nodes is whole again.
    Heal(Nodes),
    /// Something is done to the power, the wires or the reset pins of these nodes.
    Switch(Nodes, Switch),
    /// Something happens to the wires.
    Bus(BusTrouble),
    /// A broken stranger sends this identifier without a pause; `None`: no more.
    Babble(Option<u16>),
    /// The clients' adapter goes to this bit rate, kbit/s.
    BitRate(u16),
    /// Tell how things stand.
    Status,
    /// Tell the words.
    Help,
    /// End, exit status 0.
    Quit,
    /// Scripts and `plumb twin`: go on after so many seconds; `None`: when the housing stands.
    Wait(Option<f64>),
    /// Scripts: nothing more, and serve on.
    Hold,
    /// Scripts: begin again.
    Repeat,
}

/// When a command is carried out.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum When {
    /// At once: when it is typed, or with the line before it.
    #[default]
    Now,
    /// So many seconds later than that.
    After(f64),
    /// So many seconds after the script has begun.
    At(f64),
}

impl When {
    /// The time, ns, of a line that has come at `now_ns`.
    pub fn at_ns(self, now_ns: u64) -> u64 {
        let ns = |s: f64| (s * 1e9) as u64;
        match self {
            Self::Now => now_ns,
            Self::After(s) => now_ns + ns(s),
            Self::At(s) => ns(s),
        }
    }
}

impl Word {
    /// Where a housing that is to stand at `from` stands behind this word; `None` for a word that
    /// turns nothing.
    pub fn pose(&self, from: Pose) -> Option<Pose> {
        match *self {
            Self::Pitch(pitch_deg) => Some(Pose { pitch_deg, ..from }),
            Self::Roll(roll_deg) => Some(Pose { roll_deg, ..from }),
            Self::Level => Some(Pose::default()),
            _ => None,
        }
    }

    /// True for what tells a script how it goes on.
    pub const fn is_for_scripts(&self) -> bool {
        matches!(self, Self::Wait(_) | Self::Hold | Self::Repeat)
    }
}

/// One line.
#[derive(Clone, Debug, PartialEq)]
pub struct Line {
    /// When.
    pub when: When,
    /// What.
    pub word: Word,
}

/// Every word.
static WORDS: Table<Word> = Table {
    what: "word",
    before: "",
    rows: &[
        row("pitch DEGREES (-180 to 180)", "slope Y goes there", |r| {
            Ok(Word::Pitch(r.number("deg", -180.0..=180.0)?))
        }),
        row("roll DEGREES (-180 to 180)", "slope X goes there", |r| {
            Ok(Word::Roll(r.number("deg", -180.0..=180.0)?))
        }),
        row("level", "both slopes go to zero", |_| Ok(Word::Level)),
        row("rate DEG/S (0.01 to 400)", "speed of the next turns", |r| {
            Ok(Word::Rate(r.number("deg/s", 0.01..=400.0)?))
        }),
        row("vibration MG (0 to 1000)", "rms, 20 to 200 Hz", |r| {
            Ok(Word::Vibration(r.number("mg", 0.0..=1000.0)? / 1000.0))
        }),
        row(
            "temp DEGC (-40 to 85), with `now` behind it at once",
            "the chamber goes there by 2 degC/min; a sudden jump is a fault until a reset",
            |r| {
                let celsius = r.number("degC", AIR_DEGC)?;
                let at_once = r.optional(|r| r.one_of(&[("now", true)]))?;
                Ok(Word::Temperature(celsius, at_once.is_some()))
            },
        ),
        row(
            "fault NODE WHAT",
            "something breaks; WHAT is in the list below",
            |r| Ok(Word::Fault(r.nodes()?, FAULTS.read(r)?)),
        ),
        row(
            "heal NODE",
            "what was broken is whole; latched faults stay",
            |r| Ok(Word::Heal(r.nodes()?)),
        ),
        row("power NODE on|off", "the supply of a node", |r| {
            switch(r, Switch::On, Switch::Off)
        }),
        row("wire NODE on|off", "the bus wires of a node", |r| {
            switch(r, Switch::Connect, Switch::Cut)
        }),
        row("reset NODE", "the reset pin of a node", |r| {
            Ok(Word::Switch(r.nodes()?, Switch::Reset))
        }),
        row(
            "bus short SECONDS|noise SHARE|loss SHARE|double SHARE|heal (SHARE: 0 to 1)",
            "the wires of the bus",
            bus,
        ),
        row(
            "babble ID|off (ID: hexadecimal, 0 to 7FF)",
            "a stranger floods the bus",
            |r| match r.peek() {
                Some("off") => {
                    r.next();
                    Ok(Word::Babble(None))
                }
                _ => Ok(Word::Babble(Some(r.identifier()?))),
            },
        ),
        row(
            "bit-rate KBIT/S (10, 20, 50, 125, 250, 500, 800 or 1000)",
            "the clients' adapter goes there: type it after a change by LSS (`plumb bitrate`)",
            bit_rate,
        ),
        row(
            "status",
            "how things stand: what is broken, what each node shows, whom it blames and why",
            |_| Ok(Word::Status),
        ),
        row("help", "this list", |_| Ok(Word::Help)),
        row("quit", "end, exit status 0", |_| Ok(Word::Quit)),
        row(
            "wait SECONDS, or wait alone (until the housing stands still)",
            "scripts and `plumb twin` only",
            |r| Ok(Word::Wait(r.optional(|r| r.number("s", 0.0..=1e6))?)),
        ),
        row("hold", "scripts only, last line: serve on", |_| {
            Ok(Word::Hold)
        }),
        row("repeat", "scripts only, last line: begin again", |_| {
            Ok(Word::Repeat)
        }),
    ],
};

fn switch(r: &mut Reader<'_>, on: Switch, off: Switch) -> Read<Word> {
    Ok(Word::Switch(
        r.nodes()?,
        r.one_of(&[("on", on), ("off", off)])?,
    ))
}

fn bus(r: &mut Reader<'_>) -> Read<Word> {
    Ok(Word::Bus(match r.one()? {
        "short" => BusTrouble::Short(r.number("s", 0.0..=3600.0)?),
        "noise" => BusTrouble::Noise(r.share()?),
        "loss" => BusTrouble::Loss(r.share()?),
        "double" => BusTrouble::Double(r.share()?),
        "heal" => BusTrouble::Heal,
        _ => return Err(r.bad()),
    }))
}

fn bit_rate(r: &mut Reader<'_>) -> Read<Word> {
    let asked = r.number("kbit/s", 10.0..=1000.0)?;
    let rate = BIT_RATES.into_iter().find(|rate| f64::from(*rate) == asked);
    rate.map(Word::BitRate).ok_or_else(|| r.bad())
}

/// The words with their meaning, a line each.
pub fn help() -> String {
    format!(
        "{}  NODE is a, b, a2, b2, ... or all; `+SECONDS` or `at SECONDS` before a word put it \
         off\n{}{NOTE}",
        WORDS.help(),
        FAULTS.help()
    )
}

/// What a shell may offer for a line: its first words, the nodes of the first instrument, faults.
pub fn candidates() -> impl Iterator<Item = &'static str> {
    let is_other = |fault: &&str| !WORDS.names().any(|word| word == *fault);
    let faults = FAULTS.names().filter(is_other);
    WORDS.names().chain(["a", "b", "all"]).chain(faults)
}

/// Reads a line; `None` for one without words. `#` begins a comment.
///
/// Errors: [`WordError::Unknown`], [`WordError::Form`].
pub fn read(text: &str, nodes: usize) -> Result<Option<Line>, WordError> {
    let text = text.split('#').next().unwrap_or_default().trim();
    let words = with_units(text);
    let mut reader = Reader::new(text, &words, nodes);
    let when = when(&mut reader)?;
    reader.optional(|reader| {
        let word = WORDS.read(reader)?;
        Ok(Line { when, word })
    })
}

/// Reads `+SECONDS` or `at SECONDS`, behind which a word has to follow.
fn when(r: &mut Reader<'_>) -> Read<When> {
    r.form = "+SECONDS WORD or at SECONDS WORD (0 to 1000000)";
    let when = match r.peek() {
        Some("at") => {
            r.next();
            When::At(r.number("s", 0.0..=1e6)?)
        }
        Some(first) if first.starts_with('+') => When::After(r.number("s", 0.0..=1e6)?),
        _ => return Ok(When::Now),
    };
    match r.is_over() {
        true => Err(r.bad()),
        false => Ok(when),
    }
}

#[cfg(test)]
mod tests {
    use sim::lis2dw12::Fault;

    use super::*;

    fn word(text: &str) -> Word {
        read(text, 4).unwrap().unwrap().word
    }

    fn said(text: &str) -> String {
        read(text, 2).unwrap_err().to_string()
    }

    #[test]
    fn the_words_of_the_manual() {
        assert_eq!(word("pitch 30"), Word::Pitch(30.0));
        assert_eq!(word("rate 80deg/s"), Word::Rate(80.0));
        assert_eq!(word("temp -10"), Word::Temperature(-10.0, false));
        assert_eq!(word("temp 60 now"), Word::Temperature(60.0, true));
        assert_eq!(
            word("fault b stuck"),
            Word::Fault(Nodes(vec![1]), Trouble::Part(Fault::MisoHigh))
        );
        let offset = Trouble::Offset(0.05);
        assert_eq!(
            word("fault a2 offset 50mg"),
            Word::Fault(Nodes(vec![2]), offset)
        );
        assert_eq!(
            word("power all off"),
            Word::Switch(Nodes(vec![0, 1, 2, 3]), Switch::Off)
        );
        assert_eq!(word("babble 0x080"), Word::Babble(Some(0x80)));
        assert_eq!(word("bus loss 0.01"), Word::Bus(BusTrouble::Loss(0.01)));
    }

    #[test]
    fn a_time_may_stand_in_front() {
        let when = |text| read(text, 2).unwrap().unwrap().when;
        assert_eq!(when("level"), When::Now);
        assert_eq!(when("+1.5 level"), When::After(1.5));
        assert_eq!(when("at 20s level"), When::At(20.0));
    }

    #[test]
    fn a_unit_may_stand_apart_from_its_number() {
        for (apart, together) in [
            ("pitch 30 deg", "pitch 30deg"),
            ("at 5 s level", "at 5s level"),
            ("+5 s level", "+5s level"),
            ("fault a bias x 10 mg", "fault a bias x 10mg"),
            ("bit-rate 500 kbit/s", "bit-rate 500"),
        ] {
            assert_eq!(read(apart, 2), read(together, 2), "{apart}");
            assert!(matches!(read(apart, 2), Ok(Some(_))), "{apart}");
        }
        assert!(matches!(read("pitch 30 mg", 2), Err(WordError::Form(..))));
        assert!(matches!(read("pitch deg 30", 2), Err(WordError::Form(..))));
    }

    #[test]
    fn help_lists_every_word_and_every_fault() {
        let help = help();
        for row in WORDS.rows {
            let form = row.form;
            assert!(help.contains(&format!("  {form}: ")), "{form}");
        }
        for name in FAULTS.names() {
            assert!(help.contains(&format!("fault NODE {name}")), "{name}");
        }
    }

    #[test]
    fn the_page_of_words_is_fresh() {
        let page = include_str!("../../../../docs/serve.md");
        assert!(
            page.contains(&format!("```text\n{}```", help())),
            "{}",
            help()
        );
    }

    #[test]
    fn every_line_of_the_page_of_faults_has_its_word() {
        let faults = include_str!("../../../../docs/faults.md");
        let page = include_str!("../../../../docs/serve.md");
        let (_, table) = faults.split_once("### Digging").unwrap();
        let (table, _) = table.split_once("###").unwrap();
        let lines = table.lines().filter_map(|line| line.strip_prefix("| "));
        let names = lines.filter_map(|line| line.split(" | ").next());
        let mut found = 0;
        for name in names.filter(|name| !["fault", "none"].contains(name)) {
            let row = format!("\n| {} | `", name.trim_end_matches(" (bus)"));
            let (_, rest) = page.split_once(&row).expect(name);
            let (word, _) = rest.split_once('`').unwrap();
            let line = read(word, 2);
            assert!(matches!(line, Ok(Some(_))), "{name}: {word}: {line:?}");
            found += 1;
        }
        assert_eq!(found, 29, "lines of the page");
    }

    #[test]
    fn comments_and_empty_lines_hold_no_word() {
        for text in ["", "   ", "# pitch 30", "\t# at"] {
            assert_eq!(read(text, 2), Ok(None), "{text:?}");
        }
        assert_eq!(word("level # and stay"), Word::Level);
    }

    #[test]
    fn every_form_is_known_to_the_reader_and_refused_with_more_behind_it() {
        for (first, row) in WORDS.names().zip(WORDS.rows) {
            let form = row.form;
            let line = format!("{first} one two three four");
            let told = said(&line);
            let node = told.contains("no node \"one\"");
            assert!(node || told.contains(form), "{first}: {told}");
        }
    }

    #[test]
    fn each_sentence_names_what_is_wrong_and_what_to_write() {
        assert!(said("pich 30").starts_with("there is no word \"pich\"; the words are pitch, "));
        let form = "\"pitch thirty\" does not fit: write pitch DEGREES (-180 to 180)";
        assert_eq!(said("pitch thirty"), form);
        assert!(said("heal c").ends_with("are a, b, and all of them together are `all`"));
        assert!(said("+x level").contains("+SECONDS WORD"));
        let faults = "there is no fault \"bent\"; the faults are stuck, silent, spi, ";
        assert!(said("fault a bent").starts_with(faults));
        assert!(said("fault a").ends_with("bus-off, sync-lost"));
        let form = "does not fit: write fault NODE bias AXIS MG (-2000 to 2000)";
        assert!(said("fault a bias 10").ends_with(form));
        assert!(said("fault bias x 10").starts_with("there is no node \"bias\""));
    }

    #[test]
    fn a_bit_rate_that_no_node_has_was_taken() {
        for rate in BIT_RATES {
            assert_eq!(word(&format!("bit-rate {rate}")), Word::BitRate(rate));
            assert!(help().contains(&rate.to_string()), "{rate}");
        }
        for rate in ["123", "249.9", "100"] {
            let told = said(&format!("bit-rate {rate}"));
            assert!(
                told.ends_with("(10, 20, 50, 125, 250, 500, 800 or 1000)"),
                "{told}"
            );
        }
    }

    #[test]
    fn numbers_out_of_range_are_refused() {
        for text in [
            "pitch 181",
            "roll nan",
            "rate 0",
            "temp 86",
            "bus noise 1.1",
            "babble 800",
            "bit-rate 1001",
            "at -1 level",
            "wait inf",
        ] {
            assert!(matches!(read(text, 2), Err(WordError::Form(..))), "{text}");
        }
    }
}
