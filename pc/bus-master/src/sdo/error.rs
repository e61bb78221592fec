//! Why an SDO transfer did not come to its end, and what abort codes mean (CiA 301, table 22).

use canopen::object::Abort;

use crate::BusEnd;

/// Why a transfer ended. Each names node and object.
#[derive(Debug, thiserror::Error)]
pub enum SdoError {
    /// The bus can be used no longer.
    #[error(transparent)]
    Bus(#[from] BusEnd),
    /// The node does not answer a question: node, index, sub-index.
    #[error("node {0} does not answer when asked for {a}", a = address(*.1, *.2))]
    Silent(u8, u16, u8),
    /// The node did not answer a write, which it may have taken all the same.
    #[error("{a}", a = unanswered(*.0, *.1, *.2))]
    Unanswered(u8, u16, u8),
    /// It ended for this reason when a write had been sent and was not answered: node, index,
    /// sub-index.
    #[error("{0}; {a}", a = unanswered(*.1, *.2, *.3))]
    Amid(Box<Self>, u8, u16, u8),
    /// The user has ended it when a write had been sent, which the node has taken: node, index,
    /// sub-index.
    #[error("interrupted; node {0} has taken the write of {a}", a = address(*.1, *.2))]
    Behind(u8, u16, u8),
    /// The node has refused: node, index, sub-index, abort code.
    #[error(
        "node {0} refuses {a}: {b} (abort code {c})",
        a = address(*.1, *.2),
        b = meaning(*.3),
        c = coded(*.3)
    )]
    Refused(u8, u16, u8, u32),
    /// The transfer came out of step: node, index, sub-index, and what was wrong.
    #[error(
        "the transfer of {a} with node {0} is out of step ({3}): frames are lost, or another tool \
         uses its SDO server",
        a = address(*.1, *.2)
    )]
    Step(u8, u16, u8, &'static str),
    /// Somebody else uses the node's only SDO channel.
    #[error("another tool uses the SDO server of node {0}: end the other tool, or wait for it")]
    Taken(u8),
    /// The object has another length than a number has: node, index, sub-index, bytes.
    #[error("{a} of node {0} has {3} bytes and is no number", a = address(*.1, *.2))]
    Length(u8, u16, u8, usize),
}

impl SdoError {
    /// Whether the node has refused with this abort code.
    pub const fn is_refusal(&self, abort: Abort) -> bool {
        matches!(self, Self::Refused(.., code) if *code == abort.code())
    }

    /// Whether the node has said nothing at all.
    pub const fn is_silence(&self) -> bool {
        matches!(self, Self::Silent(..) | Self::Unanswered(..))
    }
}

/// The sentence for a write that was not answered: node, index, sub-index.
fn unanswered(node: u8, index: u16, sub: u8) -> String {
    let object = address(index, sub);
    format!(
        "node {node} has not answered the write of {object}: whether it counts is not known, so \
         read it back before you write again"
    )
}

/// An object's address as people write it: `6012h`, or `1018h sub 2`.
fn address(index: u16, sub: u8) -> String {
    match sub {
        0 => format!("{index:04X}h"),
        _ => format!("{index:04X}h sub {sub}"),
    }
}

/// An abort code as people write it: `0800 0022h`.
pub fn coded(code: u32) -> String {
    format!("{:04X} {:04X}h", code >> 16, code & 0xFFFF)
}

/// What an abort code means, in words (CiA 301, table 22).
pub const fn meaning(code: u32) -> &'static str {
    match code {
        0x0503_0000 => "the toggle bit did not alternate",
        0x0504_0000 => "the transfer took too long",
        0x0504_0001 => "it does not support this command",
        0x0504_0002 => "the block size is wrong",
        0x0504_0003 => "a sequence number is wrong",
        0x0504_0004 => "the check sum is wrong",
        0x0504_0005 => "it is out of memory",
        0x0601_0000 => "the object does not allow this access",
        0x0601_0001 => "the object can only be written",
        0x0601_0002 => "the object can only be read",
        0x0602_0000 => "it has no such object",
        0x0604_0041 => "the object cannot be mapped into a PDO",
        0x0604_0042 => "the mapped objects are longer than a PDO",
        0x0604_0043 => "the value does not go together with its other parameters",
        0x0604_0047 => "its own state does not allow it",
        0x0606_0000 => "its hardware failed",
        0x0607_0010 => "the value has another length than the object",
        0x0607_0012 => "the value is longer than the object",
        0x0607_0013 => "the value is shorter than the object",
        0x0609_0011 => "it has no such sub-index",
        0x0609_0030 => "the object cannot have this value",
        0x0609_0031 => "the value is above the range",
        0x0609_0032 => "the value is below the range",
        0x0609_0036 => "the highest value would be below the lowest",
        0x060A_0023 => "a resource that it needs is not there",
        0x0800_0000 => "it gives no reason",
        0x0800_0020 => "it cannot transfer or store the data",
        0x0800_0021 => "it cannot store the data since it controls them itself",
        0x0800_0022 => "it cannot do that in its present state",
        0x0800_0023 => "it has no object dictionary",
        0x0800_0024 => "there is no data",
        _ => "the standard has no words for its reason",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_code_that_our_nodes_send_has_words_of_its_own() {
        let codes = [
            Abort::ToggleBit,
            Abort::TimedOut,
            Abort::InvalidCommand,
            Abort::InvalidBlockSize,
            Abort::InvalidSequence,
            Abort::CrcError,
            Abort::OutOfMemory,
            Abort::UnsupportedAccess,
            Abort::WriteOnly,
            Abort::ReadOnly,
            Abort::NoSuchObject,
            Abort::NotMappable,
            Abort::PdoTooLong,
            Abort::ParameterIncompatible,
            Abort::InternalIncompatible,
            Abort::Hardware,
            Abort::LengthMismatch,
            Abort::LengthTooHigh,
            Abort::LengthTooLow,
            Abort::NoSuchSubIndex,
            Abort::InvalidValue,
            Abort::ValueTooHigh,
            Abort::ValueTooLow,
            Abort::MaximumBelowMinimum,
            Abort::NoResource,
            Abort::General,
            Abort::CannotStore,
            Abort::LocalControl,
            Abort::WrongState,
            Abort::NoData,
        ]
        .map(Abort::code);
        let words: std::collections::BTreeSet<_> = codes.map(meaning).into();
        assert_eq!(words.len(), codes.len());
        assert!(!words.contains(meaning(1)));
    }

    #[test]
    fn a_refusal_names_node_object_and_meaning() {
        let told = SdoError::Refused(2, 0x1018, 9, 0x0609_0011).to_string();
        assert_eq!(
            told,
            "node 2 refuses 1018h sub 9: it has no such sub-index (abort code 0609 0011h)"
        );
    }
}
