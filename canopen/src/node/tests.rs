//! The node as a whole, by conversations.
