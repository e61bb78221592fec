//! An SLCAN client on a pseudo-terminal, as on a serial adapter.
//!
//! In: nothing. Out: the path of the terminal that the client opens. The terminal stays when its
//! client goes, and the next one finds it as new. One client at a time: two programs that open
//! the same terminal would each get half of the bytes, as on a real serial line.
//!
//! Left out: systems without Unix pseudo-terminals; SLCAN over TCP serves those.

use std::path::PathBuf;
use std::sync::Arc;

use super::shared::Shared;
use crate::error::ServeError;

/// Makes a pseudo-terminal and serves it.
#[cfg(not(unix))]
pub fn open(_: &Arc<Shared>) -> Result<PathBuf, ServeError> {
    let error = std::io::Error::from(std::io::ErrorKind::Unsupported);
    Err(ServeError::Pty(error))
}

/// Makes a pseudo-terminal and serves it.
#[cfg(unix)]
pub fn open(shared: &Arc<Shared>) -> Result<PathBuf, ServeError> {
    unix::open(shared)
}

#[cfg(unix)]
mod unix {
    use std::ffi::OsString;
    use std::os::fd::OwnedFd;
    use std::os::unix::ffi::OsStringExt;
    use std::path::PathBuf;
    use std::sync::{Arc, Mutex, MutexGuard};
    use std::thread;
    use std::time::Duration;

    use rustix::event::{PollFd, PollFlags, Timespec, poll};
    use rustix::fs::{Mode, OFlags, fcntl_getfl, fcntl_setfl};
    use rustix::io::Errno;
    use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
    use rustix::termios::{OptionalActions, QueueSelector, tcflush, tcgetattr, tcsetattr};

    use super::super::dialogue::{Dialogue as _, Heard};
    use super::super::outlet::Outlet;
    use super::super::shared::{Client, Port, Shared};
    use super::super::slcan::Session;
    use crate::error::ServeError;
    use crate::threads::lock;

    /// How often a terminal without a client is looked at, and a thread looks whether to stop.
    const LOOK: Duration = Duration::from_millis(50);

    /// Nothing to do before this has passed, unless the terminal has something.
    const LOOK_FOR: Timespec = Timespec {
        tv_sec: 0,
        tv_nsec: 100_000_000,
    };

    /// Our end of the terminal, and how many clients have left it. The count is locked for each
    /// write, so that the rest of an old client's bytes can't slip to the next one.
    struct Master {
        end: OwnedFd,
        left: Mutex<u32>,
    }

    impl Master {
        fn left(&self) -> MutexGuard<'_, u32> {
            lock(&self.left)
        }

        /// Waits until there is something to do: the terminal is ready for one of `events`, has
        /// lost its client, or 100 ms are over.
        fn look(&self, events: PollFlags) -> PollFlags {
            let mut one = [PollFd::new(&self.end, events)];
            let _ = poll(&mut one, Some(&LOOK_FOR));
            one[0].revents()
        }

        /// What the last client left unread is not for the next one. Only the client's end can
        /// throw away what has arrived there, so that end is opened for a moment; what a new
        /// client writes stays.
        fn forget_unread(&self, now_left: u32) {
            let mut left = self.left();
            *left = now_left;
            let Ok(path) = ptsname(&self.end, Vec::new()) else {
                return;
            };
            // What the kernel has not yet carried to the client's end is thrown away at ours.
            let _ = tcflush(&self.end, QueueSelector::OFlush);
            let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::CLOEXEC;
            if let Ok(end) = rustix::fs::open(path, flags, Mode::empty()) {
                // A terminal that can't forget shows old frames, which is no reason to end.
                let _ = tcflush(&end, QueueSelector::IFlush);
            }
        }

        /// Writes all, unless the client that it is `for_this` has left or leaves meanwhile, or
        /// the hub stops.
        fn write(&self, mut bytes: &[u8], for_this: u32, shared: &Shared) {
            while !bytes.is_empty() && !shared.is_stopped() {
                let left = self.left();
                if *left != for_this {
                    return;
                }
                let written = rustix::io::write(&self.end, bytes);
                drop(left);
                match written {
                    Ok(length) => bytes = bytes.get(length..).unwrap_or_default(),
                    Err(Errno::AGAIN | Errno::INTR) => {
                        self.look(PollFlags::OUT);
                    }
                    // Nobody has the terminal open: these bytes were for the one who left.
                    Err(_) => return,
                }
            }
        }
    }

    pub fn open(shared: &Arc<Shared>) -> Result<PathBuf, ServeError> {
        let (master, path) = make().map_err(|error| ServeError::Pty(error.into()))?;
        let label = format!("SLCAN client on {}", path.display());
        let refused = || ServeError::Pty(std::io::Error::other("there are too many clients"));
        let joined = shared.join(label, Port::Pty(Outlet::new()));
        let client = joined.ok_or_else(refused)?;
        let master = Arc::new(Master {
            end: master,
            left: Mutex::new(0),
        });
        let at = Arc::clone(&master);
        shared.start(
            &client,
            move |shared, client| write(shared, client, &at),
            move |shared, client| read(shared, client, &master),
        )?;
        Ok(path)
    }

    fn make() -> Result<(OwnedFd, PathBuf), Errno> {
        let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY)?;
        grantpt(&master)?;
        unlockpt(&master)?;
        // Without this the terminal would send the frames back, and turn CR into LF, until the
        // client has set its own mode.
        let mut mode = tcgetattr(&master)?;
        mode.make_raw();
        tcsetattr(&master, OptionalActions::Now, &mode)?;
        let flags = fcntl_getfl(&master)?;
        fcntl_setfl(&master, flags | OFlags::NONBLOCK)?;
        let path = ptsname(&master, Vec::new())?.into_bytes();
        Ok((master, PathBuf::from(OsString::from_vec(path))))
    }

    fn read(shared: &Shared, client: &Client, master: &Master) {
        let mut dialogue = Session::new();
        let mut heard = Heard::default();
        let mut bytes = [0; 4096];
        while !shared.is_stopped() {
            match rustix::io::read(&master.end, &mut bytes) {
                Ok(length) if length > 0 => {
                    dialogue.hear(&bytes[..length], &mut heard);
                    shared.act(client, &mut heard);
                    heard.close = None;
                }
                Err(Errno::AGAIN | Errno::INTR) => {
                    master.look(PollFlags::IN);
                }
                // The last program that had the terminal open has closed it.
                _ => {
                    dialogue = Session::new();
                    vacate(shared, client, master);
                }
            }
        }
    }

    /// Makes the terminal as new, and waits for the next client.
    fn vacate(shared: &Shared, client: &Client, master: &Master) {
        let Some(outlet) = client.outlet() else {
            return;
        };
        let was_open = outlet.is_open();
        master.forget_unread(outlet.leave());
        // Whoever reads the notice may open the terminal at once, and must find it as new.
        if was_open {
            shared.notice_of(client, "left without closing its channel");
        }
        while !shared.is_stopped() && master.look(PollFlags::IN).contains(PollFlags::HUP) {
            thread::sleep(LOOK);
        }
    }

    fn write(shared: &Shared, client: &Client, master: &Master) {
        let Some(outlet) = client.outlet() else {
            return;
        };
        let mut bytes = Vec::new();
        while let Some(for_this) = outlet.next(&mut bytes) {
            master.write(&bytes, for_this, shared);
        }
    }
}
