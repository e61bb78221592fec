//! A frame as the CAN sockets of the Linux kernel have it, and back.
//!
//! In: a frame of the bus, or one of the kernel. Out: the other one; what an error means, and
//! whether a frame that the kernel has refused may be sent again.
//!
//! Left out: the sockets themselves, CAN FD, and what an error frame reports.

use std::io;
use std::time::Duration;

use canopen::Frame;
use rustix::io::Errno;
use socketcan::{CanFrame, EmbeddedFrame as _, ShouldRetry as _};

/// How long to wait when the interface's own queue is full: eight frames at 1 Mbit/s.
pub const FULL_WAIT: Duration = Duration::from_millis(1);

/// Why an interface could not be opened.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unusable {
    /// The kernel has no CAN.
    NoKernelCan,
    /// There is no such interface.
    NoInterface,
    /// It is down.
    Down,
    /// Something else.
    Other,
}

impl Unusable {
    /// What the kernel means by an error.
    pub fn of(error: &io::Error) -> Self {
        match error.raw_os_error().map(Errno::from_raw_os_error) {
            Some(Errno::AFNOSUPPORT | Errno::PROTONOSUPPORT) => Self::NoKernelCan,
            Some(Errno::NODEV | Errno::NXIO) => Self::NoInterface,
            Some(Errno::NETDOWN) => Self::Down,
            _ => Self::Other,
        }
    }
}

/// A frame of the kernel; `None` for an error frame.
pub fn from_kernel(frame: &CanFrame) -> Option<Frame> {
    match frame {
        CanFrame::Data(data) => Frame::with(data.id(), data.data()),
        CanFrame::Remote(remote) => Frame::remote(remote.id(), remote.dlc()),
        CanFrame::Error(_) => None,
    }
}

/// A frame for the kernel.
pub fn to_kernel(frame: &Frame) -> Option<CanFrame> {
    match frame.is_remote() {
        true => CanFrame::new_remote(frame.id(), frame.length()),
        false => CanFrame::new(frame.id(), frame.bytes()),
    }
}

/// True when the interface's own queue is full, or the socket was not ready: the same frame may be
/// sent again after [`FULL_WAIT`].
pub fn may_send_again(error: &io::Error) -> bool {
    error.should_retry() || error.raw_os_error() == Some(Errno::NOBUFS.raw_os_error())
}

#[cfg(test)]
mod tests {
    use super::*;
    use canopen::frame::{ExtendedId, standard};

    #[test]
    fn frames_pass_the_kernel_unchanged() {
        let long = ExtendedId::new(0x1234_5678).unwrap();
        for frame in [
            Frame::data_frame(0x80, &[]),
            Frame::data_frame(0x181, &[1, 2, 3, 4, 5, 6, 7, 8]),
            Frame::with(long, &[9]).unwrap(),
            Frame::remote(standard(0x701), 1).unwrap(),
        ] {
            let there = to_kernel(&frame).unwrap();
            assert_eq!(from_kernel(&there), Some(frame));
        }
    }

    #[test]
    fn the_kernel_tells_why_an_interface_can_not_be_opened() {
        let told = |errno: Errno| Unusable::of(&io::Error::from_raw_os_error(errno.raw_os_error()));
        assert_eq!(told(Errno::AFNOSUPPORT), Unusable::NoKernelCan);
        assert_eq!(told(Errno::NODEV), Unusable::NoInterface);
        assert_eq!(told(Errno::NETDOWN), Unusable::Down);
        assert_eq!(told(Errno::PERM), Unusable::Other);
    }

    #[test]
    fn a_full_queue_may_be_tried_again_and_a_lost_interface_may_not() {
        let error = |errno: Errno| io::Error::from_raw_os_error(errno.raw_os_error());
        assert!(may_send_again(&error(Errno::NOBUFS)));
        assert!(may_send_again(&error(Errno::AGAIN)));
        assert!(!may_send_again(&error(Errno::NETDOWN)));
    }
}
