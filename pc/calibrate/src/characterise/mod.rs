//! `plumb characterise`: the temperature model of both channels, from a chamber run over the bus.
//!
//! In: a bus with one instrument in reach, a climatic chamber around it (or a person who sets one),
//! and a motor or a person that turns it. Out: the run of R4 (section II.B), a temperature model in
//! the calibration of each node, read back and compared; report.html, report.json and dcc.xml as
//! `plumb calibrate` writes them. What was measured is kept after each dwell, so that a run that
//! was interrupted goes on with --resume.
//!
//! Left out: scale, axes and zero of the angles, which `plumb calibrate` makes and which stay.

mod air;
mod bias;
pub mod chamber;
pub mod hold;
mod left;
mod measured;
mod model;
pub mod profile;
mod report;
mod run;
mod scale;
mod stands;
mod thermal;
mod turns;

use std::path::PathBuf;
use std::process::ExitCode;

use clap::Args;

use chamber::{Chamber, HandChamber, ScpiChamber};
use left::Left;
use measured::{Begun, Measured};
use model::Model;
use profile::Profile;
use run::{Bench, Turner};

use crate::by_motor::Kind;
use crate::compose::Frame;
use crate::console::Console;
use crate::data::now;
use crate::data::{Channel, Report};
use crate::finish::{self, Done};
use crate::folder::Folder;
use crate::motor::{Axis, Motor};
use crate::session::{Session, encode};
use crate::{CalibrateError, Common, kept};
use output::progress::Progress;
use output::write::Existing;

/// What keeps the temperature, what turns the housing, and through which temperatures.
#[derive(Clone, Debug, Args)]
pub struct Arguments {
    /// Let this chamber keep the temperature: tcp://HOST:PORT or serial:///dev/ttyUSB0?baud=115200
    #[arg(long, value_name = "URL", conflicts_with_all = ["keep", "restore"])]
    pub chamber: Option<String>,
    /// Ask a person to set the chamber, and to turn the housing where no motor is named
    #[arg(long)]
    pub by_hand: bool,
    /// Let this motor turn the housing between the four orientations of a dwell: tcp://HOST:PORT or
    /// serial://PATH?baud=RATE; without one a person is asked
    #[arg(long, value_name = "URL")]
    pub motor: Option<String>,
    /// Temperature model; without it piecewise for the tables of the paper's mode, else quadratic
    #[arg(long, value_enum)]
    pub model: Option<Model>,
    /// File with the dwells, one a line: degC and minutes [default: the paper's run]
    #[arg(long, value_name = "FILE", conflicts_with_all = ["from", "to", "step", "dwell"])]
    pub profile: Option<PathBuf>,
    /// Lowest temperature of stairs, degC; -10
    #[arg(long, value_name = "DEGC", allow_negative_numbers = true)]
    pub from: Option<f64>,
    /// Highest temperature of stairs, degC; 70
    #[arg(long, value_name = "DEGC", allow_negative_numbers = true)]
    pub to: Option<f64>,
    /// Height of a stair, degC; 10
    #[arg(long, value_name = "DEGC")]
    pub step: Option<f64>,
    /// How long each stair is kept, min; 40
    #[arg(long, value_name = "MIN")]
    pub dwell: Option<f64>,
    /// How often the whole run is repeated; 2
    #[arg(long, value_name = "N")]
    pub runs: Option<u32>,
    /// Largest error over temperature, its expanded uncertainty included, deg
    #[arg(long, value_name = "DEG", default_value_t = 0.2,
          value_parser = crate::tolerance)]
    pub tolerance: f64,
    /// Folder of the report, and of what was measured so far
    #[arg(long, default_value = "characterisation-report", value_name = "DIR")]
    pub out: PathBuf,
    /// Go on with the run in that folder that was interrupted
    #[arg(long, conflicts_with_all = ["force", "keep", "restore"])]
    pub resume: bool,
    /// What every calibration over a bus has.
    #[command(flatten)]
    pub common: Common,
}

/// What it takes to reach a temperature.
const NO_CHAMBER: &str = "state what controls the temperature: --chamber URL or --by-hand; --keep \
                          and --restore FILE work without";

/// What the quadratic model takes of a motor.
const ONE_AXIS: &str = "the motor turns one axis only, and the quadratic model takes both: leave \
                        --motor out and turn the housing by hand (docs/chamber.md)";

/// What a correction by tables takes.
const TABLES: &str = "a correction by tables takes the piecewise model: leave --model out";

/// Characterises, or keeps and restores calibrations. Exit status 1: the model leaves more than the
/// tolerance, and the nodes have the calibration that they had.
///
/// Errors: see [`CalibrateError`].
pub fn run(arguments: &Arguments, progress: &Progress) -> Result<ExitCode, CalibrateError> {
    let common = &arguments.common;
    let ids = common.ids()?;
    if let Some(kept) = common.keep_or_restore(&ids)? {
        return Ok(kept);
    }
    CalibrateError::unless_one(
        [arguments.chamber.is_some(), arguments.by_hand],
        NO_CHAMBER,
        "a program or a person sets the chamber: give --chamber URL or --by-hand, not both",
    )?;
    let folder = match arguments.resume {
        true => Folder::resume(&arguments.out)?,
        false => Folder::claim(&arguments.out, common.force).map_err(|error| match error {
            CalibrateError::Earlier(..) if Folder::is_unfinished(&arguments.out) => {
                CalibrateError::Unfinished(arguments.out.clone())
            }
            error => error,
        })?,
    };
    let figures = |report: &Report| report.channels.iter().map(figures).collect();
    common.with_nodes(&ids, figures, |session| {
        characterise(arguments, progress, &folder, session)
    })
}

/// The whole of it with the chamber that was named.
fn characterise(
    arguments: &Arguments,
    progress: &Progress,
    folder: &Folder,
    session: &mut Session,
) -> Done {
    let model = model(arguments, session)?;
    let profile = sequence(arguments, model)?;
    let mut motor = arguments.motor.as_deref().map(Motor::connect);
    let motor = match (motor.take().transpose()?, model) {
        (Some(mut motor), Model::Quadratic) => {
            let axes = motor.axes()?;
            let both = [Axis::X, Axis::Y].iter().all(|axis| axes.contains(axis));
            Some(
                both.then_some(motor)
                    .ok_or(CalibrateError::Request(ONE_AXIS))?,
            )
        }
        // Level all the time: there is nothing to turn.
        (_, Model::Piecewise) | (None, _) => None,
    };
    let tell = |line: &str| progress.say(line);
    let by_person = arguments.by_hand || (motor.is_none() && model == Model::Quadratic);
    let console = by_person.then(|| Console::new(false));
    let chamber: Box<dyn Chamber> = match (&arguments.chamber, &console) {
        (Some(url), _) => Box::new(ScpiChamber::connect(url)?),
        (None, Some(console)) => Box::new(HandChamber {
            console,
            tell: &tell,
        }),
        (None, None) => return Err(CalibrateError::Request(NO_CHAMBER)),
    };
    Work {
        arguments,
        progress,
        folder,
        tell: &tell,
        console: console.as_ref(),
    }
    .run(session, chamber, motor, model, profile)
}

/// The model that goes with the nodes, unless another is asked for.
fn model(arguments: &Arguments, session: &Session) -> Result<Model, CalibrateError> {
    // Nodes of one kind have corrections of one kind.
    Kind::of(session)?;
    let first = session.nodes.first().ok_or(finish::NODES)?;
    match (Model::of(&first.calibration.correction), arguments.model) {
        // An image with tables has no room for another model.
        (Model::Piecewise, Some(Model::Quadratic)) => Err(CalibrateError::Request(TABLES)),
        (usual, asked) => Ok(asked.unwrap_or(usual)),
    }
}

/// The sequence of temperatures that was asked for.
fn sequence(arguments: &Arguments, model: Model) -> Result<Profile, CalibrateError> {
    const RUNS: u32 = 2;
    let Arguments {
        from,
        to,
        step,
        dwell,
        runs,
        ..
    } = arguments;
    let stairs = [from, to, step, dwell].iter().any(|given| given.is_some());
    let mut profile = match &arguments.profile {
        Some(path) => {
            let text = std::fs::read_to_string(path).map_err(CalibrateError::file(path))?;
            Profile::read(path, &text, RUNS)?
        }
        None if stairs => {
            let [from, to] = [from.unwrap_or(-10.0), to.unwrap_or(70.0)];
            let [step, dwell] = [step.unwrap_or(10.0), dwell.unwrap_or(40.0)];
            Profile::stairs([from, to, step, dwell], RUNS, model)?
        }
        None => Profile::paper(model),
    };
    profile.runs = runs.unwrap_or(profile.runs);
    profile.check(model)?;
    Ok(profile)
}

/// What the work needs besides the bench.
struct Work<'a> {
    arguments: &'a Arguments,
    progress: &'a Progress,
    folder: &'a Folder,
    tell: &'a dyn Fn(&str),
    console: Option<&'a Console>,
}

impl Work<'_> {
    fn run(
        &self,
        session: &mut Session,
        mut chamber: Box<dyn Chamber + '_>,
        mut motor: Option<Motor>,
        model: Model,
        profile: Profile,
    ) -> Done {
        let begun = self.begun(session, chamber.as_mut(), motor.as_mut(), model, profile)?;
        let mut measured = self.measured(session, begun)?;
        let profile = measured.begun.profile.clone();
        let task = self
            .progress
            .task("over temperature", left::whole_s(&profile) as u64);
        let turner = match (&mut motor, self.console, model) {
            (_, _, Model::Piecewise) => Turner::Nothing,
            (Some(motor), ..) => Turner::Motor(motor),
            (None, Some(console), _) => Turner::Hand(console),
            (None, None, _) => return Err(CalibrateError::Request(NO_CHAMBER)),
        };
        let mut bench = Bench {
            session: &mut *session,
            chamber: chamber.as_mut(),
            turner,
            tell: self.tell,
            left: Left::new(&profile, &task, measured.dwells.len()),
            tilts: true,
        };
        let place = self.folder.own();
        let ran = bench.run(&mut measured, &|measured| measured.save(place));
        drop(task);
        if let Err(error) = ran {
            chamber.leave();
            return Err(self.kept(error, &measured));
        }
        let done = self.finish(session, &measured);
        done.map_err(|error| self.kept(error, &measured))
    }

    /// What a run is begun with, once chamber and motor have said who they are.
    fn begun(
        &self,
        session: &Session,
        chamber: &mut dyn Chamber,
        motor: Option<&mut Motor>,
        model: Model,
        profile: Profile,
    ) -> Result<Begun, CalibrateError> {
        let name = chamber.identity()?;
        if let Some([low, high]) = chamber.range_degc()? {
            let mut all = profile.ends().into_iter().chain(profile.conditioning());
            if let Some(beyond) = all.find(|degc| !(low..=high).contains(degc)) {
                return Err(CalibrateError::Range(beyond, [low, high]));
            }
        }
        let motor = motor.map(Motor::identity).transpose()?;
        let by_hand = (model == Model::Quadratic).then(|| "a person".to_owned());
        Ok(Begun {
            model,
            chamber: name,
            turned_by: motor.or(by_hand),
            profile,
            channels: Begun::channels(&session.nodes),
        })
    }

    /// A new run, or the one to go on from.
    fn measured(&self, session: &Session, begun: Begun) -> Result<Measured, CalibrateError> {
        let found = kept::as_found(session);
        if !self.arguments.resume {
            self.folder.keep(&found)?;
            return Ok(Measured::new(begun, now()));
        }
        let measured = Measured::resume(self.folder.own(), &begun)?;
        let place = self.folder.found();
        if place.symlink_metadata().is_err() {
            kept::save(&place, &found, Existing::Replace)?;
        }
        let (over, all) = (measured.dwells.len(), begun.profile.places().count());
        (self.tell)(&format!("{over} of {all} dwells were measured before"));
        Ok(measured)
    }

    /// An error, with where what was measured stands if anything was.
    fn kept(&self, error: CalibrateError, measured: &Measured) -> CalibrateError {
        if measured.dwells.is_empty() {
            self.folder.forget();
            return error;
        }
        let own = self.folder.own();
        match measured.save(own) {
            Ok(()) => CalibrateError::Kept(Box::new(error), own.to_owned()),
            Err(why) => CalibrateError::Unkept(Box::new(error), Box::new(why)),
        }
    }

    /// Fits, writes, reports; gives back what the nodes had unless all went well.
    fn finish(&self, session: &mut Session, measured: &Measured) -> Done {
        // Nobody has put another calibration in meanwhile.
        session.recover(std::time::Duration::ZERO)?;
        let made = report::make(measured, &session.nodes)?;
        let done = self.store(session, measured, &made);
        finish::settle(self.folder, session, done)
    }

    fn store(&self, session: &mut Session, measured: &Measured, made: &[report::Made]) -> Done {
        for (place, made) in made.iter().enumerate() {
            session.write(place, &encode(&made.calibration))?;
        }
        let common = &self.arguments.common;
        let read_back = finish::made(session)?;
        let frame = Frame {
            common,
            session,
            begun: measured.begun_s,
            made: read_back,
            tolerance_deg: self.arguments.tolerance,
        };
        let report = report::report(&frame, measured, made);
        finish::publish(self.folder, session, report, &common.country)
    }
}

/// A line about a channel.
fn figures(channel: &Channel) -> String {
    let Some(thermal) = &channel.thermal else {
        return String::new();
    };
    let (low, high) = (thermal.sensor_min_degc, thermal.sensor_max_degc);
    let largest = thermal.dwells.iter().map(|dwell| dwell.largest_mg);
    let left = match channel.residual_mg {
        Some(rms_mg) => format!(
            "leaves {rms_mg:.2} mg rms, {:.2} mg at most",
            largest.fold(0.0, f64::max)
        ),
        None => "goes through its points, and what it leaves was not measured".to_owned(),
    };
    format!(
        "channel {} (node {}): {} model for {low:.0} to {high:.0} degC by its thermometer; {left} \
         (without: {:.2} mg rms), U = {:.3} deg (k = 2)\n",
        channel.channel,
        channel.node,
        thermal.model,
        thermal.without_model_mg,
        channel.expanded_uncertainty_deg
    ) + &bias(channel)
        + &scale(channel)
}

/// A line about its gyroscope.
fn bias(channel: &Channel) -> String {
    let thermal = channel.thermal.as_ref();
    let Some(bias) = thermal.and_then(|thermal| thermal.gyroscope_bias.as_ref()) else {
        return String::new();
    };
    let letter = &channel.channel;
    match &bias.refused {
        Some(refused) => format!("gyroscope {letter}: bias as it was: {refused}\n"),
        None => format!(
            "gyroscope {letter}: bias over temperature from {} rests, {} left out; {:.3} deg/s rms \
             left at a rest\n",
            bias.rests,
            bias.rests_left_out,
            bias.bias_residual_deg_s.unwrap_or_default()
        ),
    }
}

/// A line about its scale over temperature.
fn scale(channel: &Channel) -> String {
    let thermal = channel.thermal.as_ref();
    let Some(scale) = thermal.and_then(|thermal| thermal.gyroscope_scale.as_ref()) else {
        return String::new();
    };
    let letter = &channel.channel;
    if let Some(refused) = &scale.refused {
        return format!("gyroscope {letter}: scale as it was: {refused}\n");
    }
    let left_out: u32 = scale.left_out.iter().map(|left| left.turns).sum();
    let open = match &scale.open_axes[..] {
        [] => String::new(),
        open => format!("; not turned enough about axis {}", open.join(", ")),
    };
    format!(
        "gyroscope {letter}: scale over temperature from {} turns, {left_out} left out; {:.3} deg \
         rms left at the end of a turn{open}\n",
        scale.used,
        scale.scale_residual_deg.unwrap_or_default()
    )
}
