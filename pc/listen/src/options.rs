//! How a person says which instruments are on a bus.
//!
//! In: the command line, through `clap`. Out: a [`Plan`], and the devices of the data sheets.

use clap::Args;

use super::Plan;
use super::eds::{Device, EdsError, Request};

/// Which instruments there are, and what their nodes send.
#[derive(Clone, Debug, Default, Args)]
pub struct PlanOptions {
    /// Node-ids of channel A and B; of several instruments A,B,A,B, or again for each [default:
    /// 1,2; of a report 1,2 and 3,4 and so on]
    #[arg(long, value_name = "A,B", value_delimiter = ',',
          value_parser = clap::value_parser!(u8).range(1..=127))]
    pub nodes: Vec<u8>,
    /// EDS or DCF of a node, for one that is not as delivered or is no inclinometer; repeatable
    #[arg(long, value_name = "FILE[@NODE]")]
    pub eds: Vec<Request>,
}

/// Instruments that can't be looked for.
#[derive(Debug, thiserror::Error)]
pub enum PlanError {
    /// Node-ids that make no pairs.
    #[error(
        "--nodes needs two node-ids for each instrument, channel A first, each node-id once: 1,2 \
         or 1,2,3,4"
    )]
    Nodes,
    /// A number that is no node-id (CiA 301, 7.2.1).
    #[error("{0} is no node-id: give 1 to 127")]
    NodeId(u8),
    /// A data sheet that can't be used.
    #[error("{0}")]
    Eds(#[from] EdsError),
}

/// The instruments where the command line names none.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unnamed {
    /// Those that a data sheet describes, else nodes 1 and 2.
    One,
    /// Nodes 1 and 2, 3 and 4 and so on.
    All,
}

impl PlanOptions {
    /// The instruments, and what the data sheets describe.
    ///
    /// Errors: a data sheet can't be read, a number is no node-id, or the node-ids make no pairs of
    /// two different ones.
    pub fn plan(&self, unnamed: Unnamed) -> Result<(Plan, Vec<Device>), PlanError> {
        let devices: Result<Vec<_>, _> = self.eds.iter().map(Request::read).collect();
        let devices = devices?;
        let ids = match (&self.nodes[..], unnamed) {
            ([], Unnamed::All) => (1..=126).collect(),
            ([], Unnamed::One) => described(&devices),
            (named, _) => named.to_vec(),
        };
        if let Some(id) = ids.iter().find(|id| !(1..=127).contains(*id)) {
            return Err(PlanError::NodeId(*id));
        }
        let mut plan = Plan::of(pairs(&ids).ok_or(PlanError::Nodes)?);
        plan.nodes = devices.iter().map(|device| device.plan().clone()).collect();
        Ok((plan, devices))
    }
}

/// The node-ids of the instruments among them; those of one as delivered when there is none.
fn described(devices: &[Device]) -> Vec<u8> {
    let ours = devices.iter().filter(|device| device.is_inclinometer());
    let ids: Vec<u8> = ours.map(|device| device.node_id).collect();
    match ids[..] {
        [] => vec![1, 2],
        // A sheet of one channel alone: the other one has the next node-id.
        [one] if one % 2 == 1 => vec![one, one + 1],
        [one] => vec![one - 1, one],
        _ => ids,
    }
}

/// Channel A and B of each instrument; `None` where one is without the other, or there twice.
fn pairs(ids: &[u8]) -> Option<Vec<[u8; 2]>> {
    let (pairs, rest) = ids.as_chunks();
    let twice = (1..ids.len()).any(|at| ids[..at].contains(&ids[at]));
    (rest.is_empty() && !twice).then(|| pairs.to_vec())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nodes_come_in_pairs_and_once_each() {
        let pairs = |nodes: &[u8], unnamed| {
            let options = PlanOptions {
                nodes: nodes.to_vec(),
                ..PlanOptions::default()
            };
            options.plan(unnamed).ok().map(|(plan, _)| plan.pairs)
        };
        assert_eq!(pairs(&[], Unnamed::One), Some(vec![[1, 2]]));
        let all = pairs(&[], Unnamed::All).unwrap();
        assert_eq!((all.len(), all[62]), (63, [125, 126]));
        let named = Some(vec![[17, 3], [1, 2]]);
        assert_eq!(pairs(&[17, 3, 1, 2], Unnamed::All), named);
        for wrong in [
            &[1][..],
            &[1, 1],
            &[1, 2, 3],
            &[1, 2, 2, 3],
            &[0, 1],
            &[127, 128],
        ] {
            assert_eq!(pairs(wrong, Unnamed::One), None);
        }
    }
}
