//! What `plumb replay` is told about bus logs.
//!
//! In: the words of the command line, through `clap`. Out: [`Options`] and the plan in them.

use clap::Args;

use crate::watch::Plan;

/// Options that only bus logs have.
#[derive(Clone, Debug, Default, Args)]
#[command(next_help_heading = "Options for bus logs")]
pub struct Options {
    /// Only frames of this interface, as the log names it: can0, or 1 in an ASC
    #[arg(long, value_name = "NAME")]
    pub interface: Option<String>,
    /// Node-ids of channel A and B; of several instruments A,B,A,B
    #[arg(long, value_name = "A,B", value_delimiter = ',',
          value_parser = clap::value_parser!(u8).range(1..=127))]
    pub nodes: Vec<u8>,
}

impl Options {
    /// The first option that was given, for a sentence.
    pub fn given(&self) -> Option<&'static str> {
        if self.interface.is_some() {
            return Some("--interface");
        }
        (!self.nodes.is_empty()).then_some("--nodes")
    }

    /// The instruments.
    pub fn plan(&self) -> Plan {
        let (pairs, _) = self.nodes.as_chunks();
        if pairs.is_empty() {
            return Plan::default();
        }
        Plan::of(pairs.to_vec())
    }
}
