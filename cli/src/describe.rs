//! `plumb describe`: the documents by which other tools and people use the two nodes.
//!
//! In: the rows of the object dictionary (`device::objects`), the only source. Out: an electronic
//! data sheet (EDS) or a device configuration (DCF) of one channel, a DBC of what both send with
//! the mapping as delivered, or the page `docs/objects.md`. The same rows give the same bytes,
//! whatever the day and the machine; the committed copies are compared with them by a test.
//!
//! Left out: reading such files, and what a device on a bus really holds.

use std::io;
use std::path::PathBuf;
use std::process::ExitCode;

use clap::{Args, ValueEnum};
use device::objects::table::{self, Channel, Models};

use output::stdout;
use output::write::{self, Existing, not_written};

/// What to describe, and where to put it.
#[derive(Clone, Debug, Args)]
pub struct Arguments {
    /// Which document
    #[arg(value_enum)]
    pub document: Document,
    /// Whose objects: those of the product, of its variant with a gyroscope, or of the paper's
    /// instrument
    #[arg(long, value_enum, default_value = "product")]
    pub instrument: InstrumentName,
    /// Channel of an EDS or DCF; a when not given
    #[arg(long, value_enum)]
    pub channel: Option<ChannelName>,
    /// Node-id of a DCF, 1 to 127; as delivered (1 for a, 2 for b) when not given
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u8).range(1..=127))]
    pub node_id: Option<u8>,
    /// File to write; printed when not given
    #[arg(long, value_name = "FILE")]
    pub output: Option<PathBuf>,
    /// Replace the file of --output if it is there already
    #[arg(long, requires = "output")]
    pub force: bool,
}

/// What can be described.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Document {
    /// Electronic data sheet of one channel (CiA 306)
    Eds,
    /// Device configuration of one channel with its node-id (CiA 306)
    Dcf,
    /// What both channels send as delivered, for CAN tools
    Dbc,
    /// Every object, as a page for people
    Objects,
}

/// An instrument that there are documents of.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum InstrumentName {
    /// The product, for the STM32F103RC
    Product,
    /// The paper's instrument, for the STM32F103C8
    Paper,
    /// The variant of the product with a gyroscope
    Dynamic,
}

impl From<InstrumentName> for Models {
    fn from(name: InstrumentName) -> Self {
        match name {
            InstrumentName::Product => Self::PRODUCT,
            InstrumentName::Paper => Self::PAPER,
            InstrumentName::Dynamic => Self::DYNAMIC,
        }
    }
}

/// A channel by the letter on its plug.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum ChannelName {
    /// Channel A
    A,
    /// Channel B
    B,
}

impl From<ChannelName> for Channel {
    fn from(name: ChannelName) -> Self {
        match name {
            ChannelName::A => Self::A,
            ChannelName::B => Self::B,
        }
    }
}

/// Why nothing was described.
#[derive(Debug, thiserror::Error)]
pub enum DescribeError {
    /// The document is the same for both channels.
    #[error("this document holds both channels; omit --channel, or ask for eds or dcf")]
    BothChannels,
    /// The document holds no node-id.
    #[error("only a dcf holds a node-id; omit --node-id, or ask for dcf")]
    NoNodeId,
    /// The file could not be written.
    #[error("{a}", a = not_written(.0, .1, "another file with --output"))]
    Write(PathBuf, io::Error),
    /// The document could not be printed.
    #[error("the document cannot be printed: {0}; name a file with --output")]
    Print(io::Error),
}

/// Describes; exit status 0.
pub fn run(arguments: &Arguments) -> Result<ExitCode, DescribeError> {
    let text = text(arguments)?;
    match &arguments.output {
        Some(path) => {
            let saved = write::save(path, text, Existing::of(arguments.force));
            saved.map_err(|why| DescribeError::Write(path.clone(), why))?;
        }
        None => stdout::print(&text).map_err(DescribeError::Print)?,
    }
    Ok(ExitCode::SUCCESS)
}

/// The document that was asked for.
fn text(arguments: &Arguments) -> Result<String, DescribeError> {
    let one_channel = matches!(arguments.document, Document::Eds | Document::Dcf);
    if !one_channel && arguments.channel.is_some() {
        return Err(DescribeError::BothChannels);
    }
    if arguments.document != Document::Dcf && arguments.node_id.is_some() {
        return Err(DescribeError::NoNodeId);
    }
    let channel = arguments.channel.map_or(Channel::A, Channel::from);
    let models = Models::from(arguments.instrument);
    let rows = table::rows_of(models);
    Ok(match arguments.document {
        Document::Eds => codes::sheet(rows, channel),
        Document::Dcf => {
            let node_id = arguments.node_id.unwrap_or(channel.node_id());
            codes::configuration(rows, channel, node_id)
        }
        Document::Dbc => codes::database(rows),
        Document::Objects => codes::page(models, rows),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_that_do_not_apply_to_a_document_are_refused() {
        let ask = |document, channel, node_id| {
            text(&Arguments {
                instrument: InstrumentName::Product,
                document,
                channel,
                node_id,
                output: None,
                force: false,
            })
        };
        let a = Some(ChannelName::A);
        for document in [Document::Dbc, Document::Objects] {
            assert!(matches!(
                ask(document, a, None),
                Err(DescribeError::BothChannels)
            ));
        }
        for document in [Document::Dbc, Document::Objects, Document::Eds] {
            assert!(matches!(
                ask(document, None, Some(3)),
                Err(DescribeError::NoNodeId)
            ));
        }
        assert!(ask(Document::Dcf, a, Some(3)).is_ok());
    }
}
