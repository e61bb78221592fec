//! Edges of pins as interrupts: EXTI, with AFIO's choice of the port.
//!
//! In: loads and stores, edges. Out: interrupt lines. Sources: RM0008 10.3 (EXTI), 9.4 (AFIO).
//! Left out: events (EMR), lines 16 to 19, and remapping, which is stored and not obeyed.
//!
//! | offset | register | section |
//! |---|---|---|
//! | 00h | EXTI IMR; AFIO EVCR | RM0008 10.3.1; 9.4.1 |
//! | 04h | EMR; MAPR | 10.3.2; 9.4.2 |
//! | 08h | RTSR; EXTICR1, on to EXTICR4 at 14h | 10.3.3; 9.4.3 to 9.4.6 |
//! | 0Ch | FTSR | 10.3.4 |
//! | 10h | SWIER | 10.3.5 |
//! | 14h | PR | 10.3.6 |

/// Both peripherals' registers.
#[derive(Clone, Debug, Default)]
pub struct Exti {
    imr: u32,
    emr: u32,
    rtsr: u32,
    ftsr: u32,
    pr: u32,
    /// EXTICR1 to EXTICR4 (9.4.3 to 9.4.6).
    port: [u32; 4],
    evcr: u32,
    mapr: u32,
}

/// The part's lines 0 to 18 (RM0008 10.3.1).
const LINES: u32 = 0x7_FFFF;

impl Exti {
    /// A pin of port `port` (0 for A) has changed to `level`.
    pub fn edge(&mut self, port: u8, pin: u8, level: bool) {
        let pin = u32::from(pin & 15);
        let chosen = self.port.get(pin as usize / 4).copied().unwrap_or(0) >> (4 * (pin % 4)) & 0xF;
        let watched = if level { self.rtsr } else { self.ftsr };
        if chosen == u32::from(port) && watched >> pin & 1 != 0 {
            self.pr |= 1 << pin;
        }
    }

    /// Its interrupts that ask, bit n for interrupt n (RM0008 table 63).
    pub fn lines(&self) -> u64 {
        let asking = self.pr & self.imr;
        let mut lines = u64::from(asking & 0x1F) << 6;
        if asking & 0x03E0 != 0 {
            lines |= 1 << 23;
        }
        if asking & 0xFC00 != 0 {
            lines |= 1 << 40;
        }
        lines
    }

    /// A load; `offset` from 4001 0400h.
    pub fn read(&self, offset: u32) -> u32 {
        match offset {
            0x00 => self.imr,
            0x04 => self.emr,
            0x08 => self.rtsr,
            0x0C => self.ftsr,
            // 10.3.6.
            0x14 => self.pr,
            _ => 0,
        }
    }

    /// A store.
    pub fn write(&mut self, offset: u32, value: u32) {
        match offset {
            // 10.3.1 to 10.3.4.
            0x00 => self.imr = value & LINES,
            0x04 => self.emr = value & LINES,
            0x08 => self.rtsr = value & LINES,
            0x0C => self.ftsr = value & LINES,
            // 10.3.5: as if the edge had come.
            0x10 => self.pr |= value & LINES,
            // 10.3.6: a 1 takes the flag away.
            0x14 => self.pr &= !value,
            _ => {}
        }
    }

    /// A load from AFIO; `offset` from 4001 0000h.
    pub fn read_afio(&self, offset: u32) -> u32 {
        match offset {
            0x00 => self.evcr,
            0x04 => self.mapr,
            0x08..=0x14 => self
                .port
                .get((offset as usize - 8) / 4)
                .copied()
                .unwrap_or(0),
            _ => 0,
        }
    }

    /// A store to AFIO.
    pub fn write_afio(&mut self, offset: u32, value: u32) {
        match offset {
            0x00 => self.evcr = value & 0xFF,
            // 9.4.2: SWJ_CFG is read as nothing.
            0x04 => self.mapr = value & 0x001F_FFFF,
            0x08..=0x14 => {
                if let Some(place) = self.port.get_mut((offset as usize - 8) / 4) {
                    *place = value & 0xFFFF;
                }
            }
            _ => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_edge_of_the_chosen_port_asks_until_it_is_cleared() {
        let mut exti = Exti::default();
        exti.write(0x00, 1 << 3 | 1 << 7 | 1 << 12);
        exti.write(0x08, 1 << 3 | 1 << 7);
        exti.write(0x0C, 1 << 12);
        exti.write_afio(0x08, 1 << 12);
        exti.edge(0, 3, true);
        assert_eq!(exti.lines(), 0);
        exti.edge(1, 3, true);
        exti.edge(0, 7, true);
        exti.edge(0, 12, true);
        assert_eq!(exti.lines(), 1 << 9 | 1 << 23);
        exti.edge(0, 12, false);
        exti.write(0x14, 1 << 3 | 1 << 7);
        assert_eq!(exti.lines(), 1 << 40);
    }
}
