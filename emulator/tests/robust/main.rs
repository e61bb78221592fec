//! What a loss of supply and bits that go bad do to the exact images: on the bus it looks as if
//! nothing, or something that is told, has happened.

mod bad_records;
mod bad_slots;
mod bench;
mod brown_out;
mod clearing;
mod failed_trial;
mod first_angle;
mod saving;
mod store_cuts;
mod update;
mod update_cuts;
mod verifier;
mod whole_update;
