//! The words that move and break the virtual instrument, one command per line.
//!
//! In: a line of a script, or one that was typed or sent. Out: a [`Line`]: when, and what.
//! Everything that can be wrong with it is found here, before anything happens; what follows from
//! the lines before it (which pose, which time) is `script`'s to see.
//!
//! Left out: what can break in a node (`trouble`); what the words do (`stage`).

use std::ops::RangeInclusive;

use super::trouble::{self, Trouble};

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

/// Some of the nodes, by number from 0.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Nodes(pub Vec<usize>);

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
    /// The power of these nodes goes on or off.
    Power(Nodes, bool),
    /// The bus wires of these nodes are joined or cut.
    Wire(Nodes, bool),
    /// The reset pins of these nodes are pulled.
    Reset(Nodes),
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

/// Why a line is none.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum WordError {
    /// There is no such word.
    #[error("there is no word {0:?}; the words are {a}", a = all_words())]
    Unknown(String),
    /// The word is followed by something else than it should; how it is written.
    #[error("{0:?} does not fit: write {1}")]
    Form(String, &'static str),
    /// There is no such node; how many there are.
    #[error(
        "there is no node {0:?}; the nodes are {a}, and all of them together are `all`",
        a = all_nodes(*.1)
    )]
    NoNode(String, usize),
    /// There is no such fault.
    #[error("there is no fault {0:?}; the faults are {a}", a = all_faults())]
    NoFault(String),
}

fn all_words() -> String {
    let words: Vec<_> = FORMS.iter().map(|(word, ..)| *word).collect();
    words.join(", ")
}

fn all_nodes(count: usize) -> String {
    let names: Vec<_> = (0..count).map(node_name).collect();
    names.join(", ")
}

fn all_faults() -> String {
    let faults: Vec<_> = trouble::names().collect();
    faults.join(", ")
}

/// Every word, how it is written, and what it does.
const FORMS: [(&str, &str, &str); 20] = [
    ("pitch", "pitch DEGREES (-180 to 180)", "slope Y goes there"),
    ("roll", "roll DEGREES (-180 to 180)", "slope X goes there"),
    ("level", "level", "both slopes go to zero"),
    (
        "rate",
        "rate DEG/S (0.01 to 400)",
        "speed of the next turns",
    ),
    ("vibration", "vibration MG (0 to 1000)", "rms, 20 to 200 Hz"),
    (
        "temp",
        "temp DEGC (-40 to 85), with `now` behind it at once",
        "the chamber goes there by 2 degC/min; a sudden jump is a fault until a reset",
    ),
    (
        "fault",
        "fault NODE WHAT",
        "something breaks; WHAT is in the list below",
    ),
    (
        "heal",
        "heal NODE",
        "what was broken is whole; latched faults stay",
    ),
    ("power", "power NODE on|off", "the supply of a node"),
    ("wire", "wire NODE on|off", "the bus wires of a node"),
    ("reset", "reset NODE", "the reset pin of a node"),
    (
        "bus",
        "bus short SECONDS|noise SHARE|loss SHARE|double SHARE|heal (SHARE: 0 to 1)",
        "the wires of the bus",
    ),
    (
        "babble",
        "babble ID|off (ID: hexadecimal, 0 to 7FF)",
        "a stranger floods the bus",
    ),
    (
        "bit-rate",
        "bit-rate KBIT/S (10, 20, 50, 125, 250, 500, 800 or 1000)",
        "the clients' adapter goes there: type it after a change by LSS (`plumb bitrate`)",
    ),
    (
        "status",
        "status",
        "how things stand: what is broken, what each node shows, whom it blames and why",
    ),
    ("help", "help", "this list"),
    ("quit", "quit", "end, exit status 0"),
    (
        "wait",
        "wait SECONDS, or wait alone (until the housing stands still)",
        "scripts and `plumb twin` only",
    ),
    ("hold", "hold", "scripts only, last line: serve on"),
    ("repeat", "repeat", "scripts only, last line: begin again"),
];

/// The words with their meaning, a line each.
pub fn help() -> String {
    let line = |(_, form, meaning): &(&str, &str, &str)| format!("  {form}: {meaning}\n");
    let words: String = FORMS.iter().map(line).collect();
    format!(
        "{words}  NODE is a, b, a2, b2, ... or all; `+SECONDS` or `at SECONDS` before a word put \
         it off\n{}",
        trouble::help()
    )
}

/// What a shell may offer for a line: its first words, the nodes of the first instrument, faults.
pub fn candidates() -> impl Iterator<Item = &'static str> {
    let first = FORMS.iter().map(|(word, ..)| *word);
    let is_other = |fault: &&str| !FORMS.iter().any(|(word, ..)| word == fault);
    let faults = trouble::names().filter(is_other);
    first.chain(["a", "b", "all"]).chain(faults)
}

/// The name of a node: a and b of the first instrument, a2 and b2 of the second, and so on.
pub fn node_name(number: usize) -> String {
    let letter = if number.is_multiple_of(2) { 'a' } else { 'b' };
    match number / 2 {
        0 => letter.to_string(),
        instrument => format!("{letter}{}", instrument + 1),
    }
}

/// Reads a line; `None` for one without words. `#` begins a comment.
pub fn read(text: &str, nodes: usize) -> Result<Option<Line>, WordError> {
    let text = text.split('#').next().unwrap_or_default().trim();
    let words = with_units(text);
    let words: Vec<&str> = words.iter().map(String::as_str).collect();
    let (when, words) = when(text, &words)?;
    let Some((first, rest)) = words.split_first() else {
        return Ok(None);
    };
    let known = FORMS.iter().find(|(word, ..)| word == first);
    let (_, form, _) = known.ok_or_else(|| WordError::Unknown((*first).to_owned()))?;
    let reader = Reader { text, form, nodes };
    let word = reader.word(first, rest)?;
    Ok(Some(Line { when, word }))
}

/// What may stand behind a number, with a space between.
const UNITS: [&str; 10] = [
    "deg", "deg/s", "degC", "mg", "mg/s", "s", "ms", "/s", "%", "kbit/s",
];

/// The words of a line; a unit belongs to the number before it.
fn with_units(text: &str) -> Vec<String> {
    let mut words: Vec<String> = Vec::new();
    for word in text.split_ascii_whitespace() {
        match words.last_mut() {
            Some(last) if UNITS.contains(&word) && last.parse::<f64>().is_ok() => *last += word,
            _ => words.push(word.to_owned()),
        }
    }
    words
}

/// Splits off `+SECONDS` or `at SECONDS`.
fn when<'a, 'b>(text: &str, words: &'a [&'b str]) -> Result<(When, &'a [&'b str]), WordError> {
    const FORM: &str = "+SECONDS WORD or at SECONDS WORD (0 to 1000000)";
    let bad = || WordError::Form(text.to_owned(), FORM);
    let seconds = |text: &str| number(text, "s", 0.0..=1e6).ok_or_else(bad);
    let (when, rest) = match words {
        ["at", time, rest @ ..] => (When::At(seconds(time)?), rest),
        ["at"] => return Err(bad()),
        [first, rest @ ..] if first.starts_with('+') => {
            (When::After(seconds(first.trim_start_matches('+'))?), rest)
        }
        _ => return Ok((When::Now, words)),
    };
    if rest.is_empty() {
        return Err(bad());
    }
    Ok((when, rest))
}

/// A number in a range, with or without its unit.
pub fn number(text: &str, unit: &str, range: RangeInclusive<f64>) -> Option<f64> {
    let digits = text.strip_suffix(unit).unwrap_or(text);
    let number = digits.parse().ok();
    number.filter(|number: &f64| range.contains(number))
}

/// A hexadecimal identifier of 11 bits.
pub fn identifier(text: &str) -> Option<u16> {
    let digits = text.strip_prefix("0x").unwrap_or(text);
    let id = u16::from_str_radix(digits, 16).ok();
    id.filter(|id| *id <= 0x7FF)
}

/// What the rest of a line is read with.
struct Reader<'a> {
    text: &'a str,
    form: &'static str,
    nodes: usize,
}

impl Reader<'_> {
    fn bad(&self) -> WordError {
        WordError::Form(self.text.to_owned(), self.form)
    }

    fn word(&self, first: &str, rest: &[&str]) -> Result<Word, WordError> {
        Ok(match (first, rest) {
            ("pitch", [deg]) => Word::Pitch(self.number(deg, "deg", -180.0..=180.0)?),
            ("roll", [deg]) => Word::Roll(self.number(deg, "deg", -180.0..=180.0)?),
            ("level", []) => Word::Level,
            ("rate", [rate]) => Word::Rate(self.number(rate, "deg/s", 0.01..=400.0)?),
            ("vibration", [mg]) => Word::Vibration(self.number(mg, "mg", 0.0..=1000.0)? / 1000.0),
            ("temp", [celsius]) => Word::Temperature(self.celsius(celsius)?, false),
            ("temp", [celsius, "now"]) => Word::Temperature(self.celsius(celsius)?, true),
            ("fault", [who, what @ ..]) => Word::Fault(self.who(who)?, self.trouble(what)?),
            ("heal", [who]) => Word::Heal(self.who(who)?),
            ("power", [who, state]) => Word::Power(self.who(who)?, self.on(state)?),
            ("wire", [who, state]) => Word::Wire(self.who(who)?, self.on(state)?),
            ("reset", [who]) => Word::Reset(self.who(who)?),
            ("bus", what) => Word::Bus(self.bus(what)?),
            ("babble", ["off"]) => Word::Babble(None),
            ("babble", [id]) => Word::Babble(Some(identifier(id).ok_or_else(|| self.bad())?)),
            ("bit-rate", [rate]) => Word::BitRate(self.bit_rate(rate)?),
            ("status", []) => Word::Status,
            ("help", []) => Word::Help,
            ("quit", []) => Word::Quit,
            ("wait", []) => Word::Wait(None),
            ("wait", [time]) => Word::Wait(Some(self.number(time, "s", 0.0..=1e6)?)),
            ("hold", []) => Word::Hold,
            ("repeat", []) => Word::Repeat,
            _ => return Err(self.bad()),
        })
    }

    fn number(&self, text: &str, unit: &str, range: RangeInclusive<f64>) -> Result<f64, WordError> {
        number(text, unit, range).ok_or_else(|| self.bad())
    }

    fn bit_rate(&self, text: &str) -> Result<u16, WordError> {
        let asked = self.number(text, "kbit/s", 10.0..=1000.0)?;
        let rate = BIT_RATES.into_iter().find(|rate| f64::from(*rate) == asked);
        rate.ok_or_else(|| self.bad())
    }

    fn celsius(&self, text: &str) -> Result<f64, WordError> {
        self.number(text, "degC", AIR_DEGC)
    }

    fn on(&self, text: &str) -> Result<bool, WordError> {
        match text {
            "on" => Ok(true),
            "off" => Ok(false),
            _ => Err(self.bad()),
        }
    }

    fn who(&self, name: &str) -> Result<Nodes, WordError> {
        let chosen: Vec<usize> = (0..self.nodes)
            .filter(|n| name == "all" || name == node_name(*n))
            .collect();
        if chosen.is_empty() {
            return Err(WordError::NoNode(name.to_owned(), self.nodes));
        }
        Ok(Nodes(chosen))
    }

    fn trouble(&self, what: &[&str]) -> Result<Trouble, WordError> {
        let Some(first) = what.first() else {
            return Err(WordError::NoFault(String::new()));
        };
        let form = trouble::form(first).ok_or_else(|| WordError::NoFault((*first).to_owned()))?;
        trouble::read(what).ok_or_else(|| WordError::Form(self.text.to_owned(), form))
    }

    fn bus(&self, what: &[&str]) -> Result<BusTrouble, WordError> {
        let share = |text| self.number(text, "", 0.0..=1.0);
        Ok(match what {
            ["short", time] => BusTrouble::Short(self.number(time, "s", 0.0..=3600.0)?),
            ["noise", rate] => BusTrouble::Noise(share(rate)?),
            ["loss", rate] => BusTrouble::Loss(share(rate)?),
            ["double", rate] => BusTrouble::Double(share(rate)?),
            ["heal"] => BusTrouble::Heal,
            _ => return Err(self.bad()),
        })
    }
}

#[cfg(test)]
mod tests {
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
            Word::Fault(Nodes(vec![1]), Trouble::Stuck)
        );
        let offset = Trouble::Offset(0.05);
        assert_eq!(
            word("fault a2 offset 50mg"),
            Word::Fault(Nodes(vec![2]), offset)
        );
        assert_eq!(
            word("power all off"),
            Word::Power(Nodes(vec![0, 1, 2, 3]), false)
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
        for (_, form, _) in FORMS {
            assert!(help.contains(&format!("  {form}: ")), "{form}");
        }
        for name in trouble::names() {
            assert!(help.contains(&format!("fault NODE {name}")), "{name}");
        }
    }

    #[test]
    fn the_page_of_words_is_fresh() {
        let page = include_str!("../../../docs/serve.md");
        assert!(
            page.contains(&format!("```text\n{}```", help())),
            "{}",
            help()
        );
    }

    #[test]
    fn comments_and_empty_lines_say_nothing() {
        for text in ["", "   ", "# pitch 30", "\t# at"] {
            assert_eq!(read(text, 2), Ok(None), "{text:?}");
        }
        assert_eq!(word("level # and stay"), Word::Level);
    }

    #[test]
    fn every_form_is_known_to_the_reader_and_refused_with_more_behind_it() {
        for (first, form, _) in FORMS {
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
    fn a_bit_rate_that_no_node_knows_was_taken() {
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
