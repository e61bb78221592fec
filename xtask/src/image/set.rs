//! What is linked together: a bootloader and its application, for one part.

use flash::layout::{C8, Layout, RC, Slot};

use crate::chip::letter;

/// A bootloader and its application.
#[derive(Debug)]
pub struct Set {
    /// How the names of its files begin.
    pub name: &'static str,
    /// The map of its part.
    pub layout: &'static Layout,
    /// The bootloader's binary.
    pub boot: &'static str,
    /// The application's binary.
    pub app: &'static str,
    /// What statics and the stack along direct calls may take of the RAM, bytes: interrupts and
    /// calls by pointer come on top. A device that is copied on its way to its place is found by
    /// this.
    pub ram: usize,
}

/// The product, for an STM32F103RC.
const PRODUCT: Set = Set {
    name: "plumb",
    layout: &RC,
    boot: "boot",
    app: "app",
    ram: 23 * 1024,
};

/// The variant with a gyroscope, for the product's part; its bootloader is the product's.
const DYNAMIC: Set = Set {
    name: "plumb-dynamic",
    layout: &RC,
    boot: "boot",
    app: "app-dynamic",
    ram: 23 * 1024,
};

/// The paper's instrument, for an STM32F103C8.
const PAPER: Set = Set {
    name: "plumb-paper",
    layout: &C8,
    boot: "boot-paper",
    app: "app-paper",
    ram: C8.ram as usize,
};

/// Every set.
pub fn sets() -> &'static [Set] {
    &[PRODUCT, DYNAMIC, PAPER]
}

impl Set {
    /// Its binaries.
    pub fn programs(&self) -> [&'static str; 2] {
        [self.boot, self.app]
    }

    /// The slots that an application is linked for.
    pub fn slots(&self) -> impl Iterator<Item = Slot> {
        let slots = [Slot::A, Slot::B];
        slots
            .into_iter()
            .filter(|slot| self.layout.slot(*slot).is_some())
    }

    /// What the application for `slot` is called: `app-a`, `app-b`, `app-paper`.
    pub fn name_of_app(&self, slot: Slot) -> String {
        match self.layout.b {
            Some(_) => format!("{}-{}", self.app, letter(slot)),
            None => self.app.to_string(),
        }
    }
}
