//! A CAN interface of the Linux kernel as one more client of the bus.
//!
//! In: the name of an interface that is up. Out: its frames for the bus, and the bus's frames on
//! it. The kernel itself shows them to the other programs on that interface, and doesn't show us
//! our own.
//!
//! Left out: setting the interface up (bit rate, state), error frames, CAN FD, other systems.

use std::sync::Arc;

use super::shared::Shared;
use crate::error::ServeError;

/// Joins an interface.
#[cfg(not(target_os = "linux"))]
pub fn open(_: &Arc<Shared>, name: &str) -> Result<(), ServeError> {
    Err(ServeError::NoKernelCan(name.to_owned()))
}

/// Joins an interface.
#[cfg(target_os = "linux")]
pub fn open(shared: &Arc<Shared>, name: &str) -> Result<(), ServeError> {
    linux::open(shared, name)
}

#[cfg(target_os = "linux")]
mod linux {
    use std::io;
    use std::sync::Arc;
    use std::sync::atomic::AtomicBool;
    use std::sync::mpsc::{Receiver, sync_channel};
    use std::thread;
    use std::time::Duration;

    use can_text::kernel::{FULL_WAIT, Unusable, from_kernel, may_send_again, to_kernel};
    use canopen::Frame;
    use socketcan::{CanSocket, ShouldRetry as _, Socket as _};

    use super::super::shared::{Client, Port, Shared};
    use crate::error::ServeError;

    /// Frames that may wait for the interface.
    const QUEUE: usize = 4096;

    /// How often the threads look whether to stop.
    const LOOK: Duration = Duration::from_millis(100);

    pub fn open(shared: &Arc<Shared>, name: &str) -> Result<(), ServeError> {
        let socket = CanSocket::open(name).map_err(|error| unusable(name, error))?;
        let timed = socket.set_read_timeout(LOOK);
        timed.map_err(|error| ServeError::Interface(name.to_owned(), error))?;
        let (sender, frames) = sync_channel(QUEUE);
        let joined = shared.join(
            format!("CAN interface {name}"),
            Port::Kernel(sender, AtomicBool::new(false)),
        );
        let full = || ServeError::Interface(name.to_owned(), io::Error::other("too many clients"));
        let client = joined.ok_or_else(full)?;
        let socket = Arc::new(socket);
        let at = Arc::clone(&socket);
        shared.start(
            &client,
            move |shared, client| write(shared, client, &at, &frames),
            move |shared, client| read(shared, client, &socket),
        )
    }

    fn unusable(name: &str, error: io::Error) -> ServeError {
        match Unusable::of(&error) {
            Unusable::NoKernelCan => ServeError::NoKernelCan(name.to_owned()),
            Unusable::NoInterface => ServeError::NoInterface(name.to_owned()),
            Unusable::Down | Unusable::Other => ServeError::Interface(name.to_owned(), error),
        }
    }

    fn read(shared: &Shared, client: &Client, socket: &CanSocket) {
        while !shared.is_stopped() {
            match socket.read_frame() {
                Ok(frame) => {
                    if let Some(frame) = from_kernel(&frame)
                        && !shared.submit(client, frame)
                    {
                        return;
                    }
                }
                Err(error) if error.should_retry() => {}
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) => return shared.leave(client, &format!("is lost: {error}")),
            }
        }
    }

    fn write(shared: &Shared, client: &Client, socket: &CanSocket, frames: &Receiver<Frame>) {
        while !shared.is_stopped() {
            let Some(frame) = frames.recv_timeout(LOOK).ok().as_ref().and_then(to_kernel) else {
                continue;
            };
            while let Err(error) = socket.write_frame(&frame) {
                if shared.is_stopped() {
                    return;
                }
                if !may_send_again(&error) {
                    return shared.leave(client, &format!("is lost: {error}"));
                }
                thread::sleep(FULL_WAIT);
            }
        }
    }

    #[cfg(test)]
    mod tests {
        use super::*;
        use rustix::io::Errno;

        #[test]
        fn each_way_to_fail_has_its_own_sentence() {
            let said = |errno: Errno| {
                let error = io::Error::from_raw_os_error(errno.raw_os_error());
                unusable("can3", error).to_string()
            };
            assert!(said(Errno::NODEV).starts_with("there is no CAN interface can3"));
            assert!(said(Errno::AFNOSUPPORT).contains("can3: this system has no SocketCAN"));
            assert!(said(Errno::PERM).starts_with("cannot use the CAN interface can3"));
        }
    }
}
