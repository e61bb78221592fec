//! What the verbs on nodes have in common on the command line: which nodes, on which bus, and how
//! the answer is printed.

use clap::Args;

use super::answer::Answer;
use bus_master::fault::Fault;
use bus_master::nodes::NodeOption;
use bus_master::{Bus, BusOptions};

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
