//! Service data objects (CiA 301, 7.2.4): the server.
//!
//! In: a client's requests. Out: one response to each, or the segments of a block. Expedited,
//! segmented and block transfer in both directions. Strings and DOMAINs of any length stream
//! through; no more than eight bytes of a transfer are held here.
//!
//! Left out: the client, and further servers (1201h and up).

pub mod abort;
mod block_download;
mod block_upload;
mod content;
mod segmented;
mod server;
#[cfg(test)]
mod tests;

pub use server::{Server, TIMEOUT_MS};
