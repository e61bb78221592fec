//! What the verbs on nodes have in common on the command line: which nodes, on which bus, and how
//! the answer is printed.

use canopen::object::Abort;
use clap::Args;

use super::answer::Answer;
use super::error::CommissionError;
use bus_master::fault::{self, Fault};
use bus_master::nodes::NodeOption;
use bus_master::{Bus, BusOptions};

/// The abort code of what can't be done in a node's present state.
pub const WRONG_STATE: u32 = Abort::WrongState.code();

/// What is said of a node that is left in PRE-OPERATIONAL, if it is.
pub fn left(node: u8, is_left: bool) -> String {
    match is_left {
        true => format!("note: {}\n", fault::unknown(node)),
        false => String::new(),
    }
}

/// What ended a verb, with the nodes that are left in PRE-OPERATIONAL out of a state that is not
/// known.
pub fn unknown(why: CommissionError, nodes: &[u8]) -> CommissionError {
    nodes.iter().fold(why, |why, node| {
        Fault::Unknown(why.to_string(), *node).into()
    })
}

/// The options of every verb on nodes.
#[derive(Clone, Debug, Args)]
pub struct CommonOptions {
    /// Print one JSON object
    #[arg(long)]
    pub json: bool,
    /// Which nodes.
    #[command(flatten)]
    pub nodes: NodeOption,
    /// The bus.
    #[command(flatten)]
    pub bus: BusOptions,
}

impl CommonOptions {
    /// Joins the bus.
    ///
    /// Errors: [`Fault::Join`].
    pub fn join(&self) -> Result<Bus, Fault> {
        Ok(self.bus.join()?)
    }

    /// An answer of this format.
    pub const fn answer(&self, format: &'static str) -> Answer {
        Answer {
            format,
            json: self.json,
        }
    }
}
