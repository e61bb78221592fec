//! How a person names the bus: `--bus URL`, or python-can's flags and variables.
//!
//! In: the command line and `CAN_INTERFACE`, `CAN_CHANNEL`, `CAN_BITRATE`. Out: a bus that was
//! joined. A flag wins over the variable of the same meaning, and `--bus` over all variables.
//! Nothing given is the bus of `plumb serve` on this computer.
//!
//! Left out: python-can's configuration files.

use clap::Args;

use can_text::socketcand::PORT;

use super::address::{self, Address, BUS_NAME, BusAddress};
use super::{Bus, JoinError};
use can_text::slcan::RATES;

/// The bus.
#[derive(Clone, Debug, Default, PartialEq, Eq, Args)]
#[command(next_help_heading = "Bus")]
pub struct BusOptions {
    /// The bus as one word: socketcand://HOST:PORT/NAME, slcan://HOST:PORT,
    /// slcan:///dev/ttyACM0, socketcan://can0, or HOST:PORT [default: the one of `plumb serve`]
    #[arg(long, value_name = "URL")]
    pub bus: Option<String>,
    /// Kind of the adapter as in python-can: socketcand, slcan, socketcan [env: CAN_INTERFACE]
    #[arg(short, long, value_name = "KIND")]
    pub interface: Option<String>,
    /// Its channel: NAME or HOST:PORT/NAME, a serial port or HOST:PORT, can0 [env: CAN_CHANNEL]
    #[arg(short, long, value_name = "CHANNEL")]
    pub channel: Option<String>,
    /// Bit rate to set in an SLCAN adapter, bit/s [env: CAN_BITRATE]
    #[arg(short, long, value_name = "BIT/S")]
    pub bitrate: Option<String>,
}

impl BusOptions {
    /// Joins the bus.
    ///
    /// Errors: see [`JoinError`].
    pub fn join(&self) -> Result<Bus, JoinError> {
        Bus::join(&self.address()?)
    }

    /// Which bus is meant.
    ///
    /// Errors: [`JoinError::Both`], and names that are none.
    pub fn address(&self) -> Result<BusAddress, JoinError> {
        self.address_with(|name| std::env::var(name).ok().filter(|value| !value.is_empty()))
    }

    fn address_with(
        &self,
        variable: impl Fn(&str) -> Option<String>,
    ) -> Result<BusAddress, JoinError> {
        let bitrate = self.bitrate.clone().or_else(|| variable("CAN_BITRATE"));
        let kbit_s = bitrate.as_deref().map(kbit_s).transpose()?;
        if let Some(url) = &self.bus {
            for (flag, given) in [("-i", &self.interface), ("-c", &self.channel)] {
                if given.is_some() {
                    return Err(JoinError::Both(flag));
                }
            }
            let at = address::parse(url)?;
            return Ok(BusAddress { at, kbit_s });
        }
        let interface = self.interface.clone();
        let interface = interface.or_else(|| variable("CAN_INTERFACE"));
        let channel = self.channel.clone().or_else(|| variable("CAN_CHANNEL"));
        let at = named(interface.as_deref(), channel.as_deref())?;
        Ok(BusAddress { at, kbit_s })
    }
}

/// An interface and a channel as python-can has them.
fn named(interface: Option<&str>, channel: Option<&str>) -> Result<Address, JoinError> {
    let served = format!("127.0.0.1:{PORT}");
    match (interface, channel) {
        (None | Some("socketcand"), None) => address::socketcand(&format!("{served}/{BUS_NAME}")),
        (None | Some("socketcand"), Some(channel)) if channel.contains(':') => {
            address::socketcand(channel)
        }
        (None | Some("socketcand"), Some(channel)) => {
            address::socketcand(&format!("{served}/{channel}"))
                .map_err(|_| JoinError::Address(channel.to_owned()))
        }
        (Some("slcan"), channel) => address::slcan(channel.unwrap_or("/dev/ttyACM0")),
        (Some("socketcan"), channel) => address::kernel(channel.unwrap_or("can0")),
        (Some(other), _) => Err(JoinError::Interface(other.to_owned())),
    }
}

/// Bit/s as kbit/s; python-can's unit is bit/s, and who writes 250 means kbit/s all the same.
fn kbit_s(text: &str) -> Result<u32, JoinError> {
    let wrong = || JoinError::BitRate(text.to_owned());
    let number: u32 = text.trim().parse().map_err(|_| wrong())?;
    let kbit_s = match number {
        0..=1000 => number,
        _ if number.is_multiple_of(1000) => number / 1000,
        _ => return Err(wrong()),
    };
    RATES.contains(&kbit_s).then_some(kbit_s).ok_or_else(wrong)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn address(options: &BusOptions, variables: &[(&str, &str)]) -> String {
        let variable = |name: &str| {
            let found = variables.iter().find(|(known, _)| *known == name);
            found.map(|(_, value)| (*value).to_owned())
        };
        match options.address_with(variable) {
            Ok(found) => match found.kbit_s {
                Some(rate) => format!("{found} {rate}"),
                None => found.to_string(),
            },
            Err(error) => error.to_string(),
        }
    }

    fn options(interface: &str, channel: &str) -> BusOptions {
        let some = |text: &str| Some(text.to_owned()).filter(|text| !text.is_empty());
        BusOptions {
            interface: some(interface),
            channel: some(channel),
            ..BusOptions::default()
        }
    }

    #[test]
    fn nothing_given_is_the_bus_of_plumb_serve() {
        let nothing = BusOptions::default();
        assert_eq!(address(&nothing, &[]), "socketcand://127.0.0.1:29536/plumb");
    }

    #[test]
    fn a_flag_wins_over_its_variable() {
        let set = [
            ("CAN_INTERFACE", "slcan"),
            ("CAN_CHANNEL", "/dev/ttyUSB3"),
            ("CAN_BITRATE", "500000"),
        ];
        let nothing = BusOptions::default();
        assert_eq!(address(&nothing, &set), "slcan:///dev/ttyUSB3 500");
        let flag = options("socketcan", "can2");
        assert_eq!(address(&flag, &set), "socketcan://can2 500");
        let url = BusOptions {
            bus: Some("pi:1".to_owned()),
            ..BusOptions::default()
        };
        assert_eq!(address(&url, &set), "socketcand://pi:1/plumb 500");
    }

    #[test]
    fn a_url_and_a_flag_together_are_an_error_that_names_the_flag() {
        let both = BusOptions {
            bus: Some("can0".to_owned()),
            ..options("slcan", "")
        };
        assert!(address(&both, &[]).contains("--bus and -i both name a bus"));
        let both = BusOptions {
            bus: Some("can0".to_owned()),
            ..options("", "x")
        };
        assert!(address(&both, &[]).contains("--bus and -c both name a bus"));
    }

    #[test]
    fn channels_are_those_of_python_can() {
        for (interface, channel, url) in [
            ("socketcand", "vcan0", "socketcand://127.0.0.1:29536/vcan0"),
            ("", "pi:7/can1", "socketcand://pi:7/can1"),
            ("slcan", "socket://pi:7", "slcan://pi:7"),
            ("slcan", "/dev/pts/4", "slcan:///dev/pts/4"),
            ("socketcan", "", "socketcan://can0"),
        ] {
            assert_eq!(address(&options(interface, channel), &[]), url);
        }
        assert!(address(&options("pcan", ""), &[]).contains("take socketcand, slcan"));
        assert!(address(&options("", "/dev/ttyACM0"), &[]).contains("is no bus"));
    }

    #[test]
    fn bit_rates_are_those_that_slcan_has_letters_for() {
        for (text, rate) in [("250000", 250), ("1000000", 1000), ("125", 125)] {
            assert_eq!(kbit_s(text).unwrap(), rate);
        }
        for text in ["", "fast", "300000", "250001", "-1", "99999999999"] {
            assert!(kbit_s(text).is_err(), "{text}");
        }
    }
}
