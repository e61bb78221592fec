//! The core: Unicorn's Cortex-M3, with what it needs to behave as one.
//!
//! In: flash and RAM as memory of the engine, everything else through the [`Chip`]. Out: [`Stop`].
//! Before each block of code the chip is told how many instructions it has and may stop the core
//! there, never inside of it; so the count of instructions is exact, skipped ones of an IT block
//! included, and an exception comes at most one block late.
//!
//! What the engine does otherwise than the part, and what is done about it:
//! - a store into flash lands in memory before the flash controller has judged it: the chip keeps
//!   what the cells hold, and the engine's copy is put right before the next block;
//! - a WFI ends the run without a word, a WFE and a YIELD as an invalid instruction, all with the
//!   program counter behind them;
//! - a branch to an EXC_RETURN arrives as an interrupt with the program counter there.
//!
//! Left out: code in the RAM, where a fetch ends in a fault; cycles, one instruction counts as
//! one; and the fault that LDM, STM, LDRD and STRD at
//! an address that is not aligned end in, which the engine carries out.

use std::fmt;

use flash::layout::{BASE, RAM};
use unicorn_engine::{
    Arch, ArmCpuModel, HookType, MemType, Mode, Prot, RegisterARM, TlbEntry, TlbType, Unicorn,
    uc_error,
};

use crate::chip::Chip;
use crate::code::{Block, WFE, WFI, YIELD};
use crate::cpu::{ALIAS, Cpu, Fault, NoMemory, Register, Stop};
use crate::exceptions::{IT_STATE, Masks};

/// QEMU's numbers of exceptions that the engine reports as interrupts.
mod number {
    pub const SUPERVISOR_CALL: u32 = 2;
    pub const PREFETCH_ABORT: u32 = 3;
    pub const DATA_ABORT: u32 = 4;
    pub const BREAKPOINT: u32 = 7;
    pub const EXCEPTION_EXIT: u32 = 8;
    pub const UNALIGNED: u32 = 22;
}

/// From here on a branch is a return from an exception (PM0056 2.3.7).
const EXC_RETURN: u32 = 0xFFFF_FFF0;
/// There is code below this address only.
const CODE_END: u32 = 0x2000_0000;
/// Peripherals, and the bit-band alias of them and of the RAM (RM0008 3.3, 3.3.2).
const MMIO: [(u32, u32); 4] = [
    (0x1FFF_F000, 0x1000),
    (0x4000_0000, 0x3_0000),
    (0x2200_0000, 0x10_0000),
    (0x4200_0000, 0x60_0000),
];
/// The core's own registers (PM0056 4), and behind them those of the debug unit (RM0008 31).
const PRIVATE: (u32, u32) = (0xE000_0000, 0x10_0000);

/// What the hooks and the runner share.
#[derive(Debug)]
struct Shared {
    chip: Chip,
    /// Why the core is to stop; noted by a hook.
    stop: Option<Stop>,
    /// The block under way.
    block: (u32, u32),
    /// No block has begun since the core was started: the first one is let through.
    fresh: bool,
}

/// Unicorn with a chip around it.
pub struct UnicornCpu {
    engine: Unicorn<'static, Shared>,
}

impl fmt::Debug for UnicornCpu {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("UnicornCpu")
            .field("shared", self.engine.get_data())
            .finish()
    }
}

impl UnicornCpu {
    /// A core with empty memories of this part around `chip`.
    ///
    /// # Panics
    /// When the engine cannot be built, which is for want of memory.
    pub fn new(chip: Chip) -> Self {
        let (flash, ram) = (chip.flash_size(), chip.ram_size());
        let shared = Shared {
            chip,
            stop: None,
            block: (0, 0),
            fresh: true,
        };
        let engine = build(shared, flash, ram);
        Self {
            engine: engine.expect("the engine needs memory, and nothing else can fail"),
        }
    }

    /// What the engine says that it is: its number of the model.
    pub fn model(&self) -> i32 {
        self.engine.ctl_get_cpu_model().unwrap_or(-1)
    }

    fn stopped(&mut self, ended: Result<(), uc_error>) -> Stop {
        let noted = self.engine.get_data_mut().stop.take();
        let at = self.register(Register::Pc);
        let stop = match (noted, ended, self.hint_before(at)) {
            (Some(stop), ..) => stop,
            (None, Ok(()), WFI) => Stop::WaitForInterrupt,
            (None, Err(uc_error::INSN_INVALID), WFE) => Stop::WaitForEvent,
            (None, Ok(()), _) | (None, Err(uc_error::INSN_INVALID), YIELD) => Stop::Wanted,
            (None, Err(uc_error::INSN_INVALID), _) => Stop::Fault(Fault::Undefined),
            (None, Err(_), _) if at >= EXC_RETURN => Stop::ExceptionReturn(at | 1),
            (None, Err(_), _) => Stop::Fault(Fault::Fetch { address: at }),
        };
        if let Stop::Fault(_) = stop {
            self.take_back(at);
        }
        stop
    }

    /// The half-word before `at`, where the block under way ends with it.
    fn hint_before(&self, at: u32) -> u16 {
        let (begin, size) = self.engine.get_data().block;
        let mut half_word = [0; 2];
        let ended = begin.wrapping_add(size) == at && size >= 2;
        match ended && self.read(at.wrapping_sub(2), &mut half_word).is_ok() {
            true => u16::from_le_bytes(half_word),
            false => 0,
        }
    }

    /// Takes back what was counted of a block that ended early, at `at`.
    fn take_back(&mut self, at: u32) {
        let (begin, size) = self.engine.get_data().block;
        let Some(left) = begin
            .wrapping_add(size)
            .checked_sub(at)
            .filter(|n| *n <= size)
        else {
            return;
        };
        let mut bytes = vec![0; left as usize];
        if self.read(at, &mut bytes).is_ok() {
            let count = Block::of(&bytes).instructions;
            self.engine.get_data_mut().chip.take_back(count);
        }
    }
}

fn build(shared: Shared, flash: u32, ram: u32) -> Result<Unicorn<'static, Shared>, uc_error> {
    let mut engine = Unicorn::new_with_data(Arch::ARM, Mode::THUMB, shared)?;
    engine.ctl_set_cpu_model(ArmCpuModel::CORTEX_M3 as i32)?;
    engine.ctl_exits_enable()?;
    let read_only = Prot::READ | Prot::EXEC;
    engine.mem_map(BASE.into(), flash.into(), read_only)?;
    engine.mem_map(ALIAS.into(), flash.into(), read_only)?;
    // The engine watches a page for code that changes, at each store, unless there can be none.
    engine.mem_map(RAM.into(), ram.into(), Prot::READ | Prot::WRITE)?;
    for (base, size) in MMIO.into_iter().chain([PRIVATE]) {
        map_registers(&mut engine, base, size)?;
    }
    engine.ctl_set_tlb_type(TlbType::VIRTUAL)?;
    engine.add_tlb_hook(1, 0, |engine, page, _| {
        leave_it_block(engine);
        Some(translation(page as u32))
    })?;
    engine.add_block_hook(1, 0, |engine, address, size| {
        before_block(engine, address as u32, size);
    })?;
    engine.add_intr_hook(on_interrupt)?;
    // A hook that watches the RAM would make each store into it slow.
    for base in [BASE, ALIAS] {
        let last = u64::from(base + flash - 1);
        let writes = HookType::MEM_WRITE_PROT;
        engine.add_mem_hook(
            writes,
            base.into(),
            last,
            |engine, _, address, size, value| {
                let chip = &mut engine.get_data_mut().chip;
                chip.store_in_flash(address as u32, size as u32, value as u32)
            },
        )?;
    }
    let behind = u64::from(RAM + ram);
    for (first, last) in [(0, u64::from(RAM) - 1), (behind, u64::from(u32::MAX))] {
        let unmapped = HookType::MEM_UNMAPPED;
        engine.add_mem_hook(unmapped, first, last, |engine, kind, address, _, _| {
            note_unmapped(engine, kind, address as u32)
        })?;
    }
    Ok(engine)
}

/// What a page may be used for: the core's own map (PM0056 2.2.3), but that there is no code in
/// the RAM. The engine goes the long way at each store into a page that may have some.
fn translation(page: u32) -> TlbEntry {
    let perms = match page {
        CODE_END.. => Prot::READ | Prot::WRITE,
        _ => Prot::ALL,
    };
    TlbEntry {
        paddr: page.into(),
        perms,
    }
}

/// Takes back what the engine does before it calls a hook in the middle of a block: it notes where
/// in an IT block the code is, and would take the next block for the rest of that one.
fn leave_it_block(engine: &mut Unicorn<'_, Shared>) {
    let xpsr = engine.reg_read(RegisterARM::XPSR).unwrap_or(0);
    if xpsr as u32 & IT_STATE != 0 {
        let _ = engine.reg_write(RegisterARM::XPSR, xpsr & !u64::from(IT_STATE));
    }
}

/// Notes a load, a store or a fetch where nothing is; false, since nobody has handled it.
fn note_unmapped(engine: &mut Unicorn<'_, Shared>, kind: MemType, address: u32) -> bool {
    let stop = match kind {
        MemType::FETCH_UNMAPPED if address >= EXC_RETURN => Stop::ExceptionReturn(address | 1),
        MemType::FETCH_UNMAPPED => Stop::Fault(Fault::Fetch { address }),
        _ => Stop::Fault(Fault::Bus { address }),
    };
    engine.get_data_mut().stop = Some(stop);
    false
}

fn map_registers(
    engine: &mut Unicorn<'static, Shared>,
    base: u32,
    size: u32,
) -> Result<(), uc_error> {
    engine.mmio_map(
        base.into(),
        size.into(),
        Some(
            move |engine: &mut Unicorn<'_, Shared>, offset: u64, size: usize| {
                let address = base.wrapping_add(offset as u32);
                if let Some((byte, bit)) = crate::chip::bit_band::in_ram(address) {
                    let mut value = [0];
                    let _ = engine.mem_read(byte.into(), &mut value);
                    return u64::from(value[0] >> bit & 1);
                }
                u64::from(engine.get_data_mut().chip.read(address, size as u32))
            },
        ),
        Some(
            move |engine: &mut Unicorn<'_, Shared>, offset: u64, size: usize, value: u64| {
                let address = base.wrapping_add(offset as u32);
                if let Some((byte, bit)) = crate::chip::bit_band::in_ram(address) {
                    let mut held = [0];
                    let _ = engine.mem_read(byte.into(), &mut held);
                    let set = ((value & 1) as u8) << bit;
                    let _ = engine.mem_write(byte.into(), &[held[0] & !(1 << bit) | set]);
                    return;
                }
                let chip = &mut engine.get_data_mut().chip;
                chip.write(address, size as u32, value as u32);
            },
        ),
    )
}

/// Counts the block, or stops before it.
fn before_block(engine: &mut Unicorn<'_, Shared>, address: u32, size: u32) {
    let shared = engine.get_data_mut();
    if shared.stop.is_some() {
        return;
    }
    let fresh = std::mem::take(&mut shared.fresh);
    if !fresh && shared.chip.needs_attention() {
        shared.chip.attend();
        if shared.chip.wants_stop() || interrupted(engine) {
            // The chip's own stop counts with no block begun.
            engine.get_data_mut().stop = Some(Stop::Wanted);
            let _ = engine.emu_stop();
            return;
        }
    }
    if engine.get_data().chip.watches() {
        let mut bytes = vec![0; size as usize];
        let _ = engine.mem_read(address.into(), &mut bytes);
        engine.get_data_mut().chip.note_passing(address, &bytes);
    }
    let shared = engine.get_data_mut();
    shared.block = (address, size);
    if let Some(block) = shared.chip.code.known(address, size) {
        shared.chip.begin_block(block);
    } else {
        learn_block(engine, address, size);
    }
}

/// Counts the instructions of a block that has not run before.
fn learn_block(engine: &mut Unicorn<'_, Shared>, address: u32, size: u32) {
    let mut bytes = vec![0; size as usize];
    let _ = engine.mem_read(address.into(), &mut bytes);
    let block = Block::of(&bytes);
    let chip = &mut engine.get_data_mut().chip;
    chip.code.learn(address, size, block);
    chip.begin_block(block);
}

/// Whether an exception is to be taken here.
fn interrupted(engine: &Unicorn<'_, Shared>) -> bool {
    let read = |register| engine.reg_read(register).unwrap_or(0) as u32;
    let nvic = &engine.get_data().chip.nvic;
    let Some(waiting) = nvic.first() else {
        return false;
    };
    let masks = Masks {
        primask: read(RegisterARM::PRIMASK) != 0,
        faultmask: read(RegisterARM::FAULTMASK) != 0,
        basepri: read(RegisterARM::BASEPRI) as u8,
    };
    // Inside of an IT block the engine cannot be sent elsewhere.
    masks.let_through(waiting, nvic) && read(RegisterARM::XPSR) & IT_STATE == 0
}

/// An exception that the engine knows of: notes it, and stops.
fn on_interrupt(engine: &mut Unicorn<'_, Shared>, number: u32) {
    let at = engine.reg_read(RegisterARM::PC).unwrap_or(0) as u32;
    let stop = match number {
        number::SUPERVISOR_CALL => Stop::SupervisorCall,
        number::PREFETCH_ABORT | number::EXCEPTION_EXIT if at >= EXC_RETURN => {
            Stop::ExceptionReturn(at | 1)
        }
        number::PREFETCH_ABORT => Stop::Fault(Fault::Fetch { address: at }),
        number::UNALIGNED | number::DATA_ABORT => Stop::Fault(Fault::Unaligned),
        number::BREAKPOINT => Stop::Fault(Fault::Breakpoint),
        _ => Stop::Fault(Fault::Undefined),
    };
    engine.get_data_mut().stop.get_or_insert(stop);
    let _ = engine.emu_stop();
}

fn name(register: Register) -> i32 {
    let name = match register {
        Register::R(number) => return RegisterARM::R0 as i32 + i32::from(number.min(12)),
        Register::Sp => RegisterARM::SP,
        Register::Lr => RegisterARM::LR,
        Register::Pc => RegisterARM::PC,
        Register::Xpsr => RegisterARM::XPSR,
        Register::Msp => RegisterARM::MSP,
        Register::Psp => RegisterARM::PSP,
        Register::Primask => RegisterARM::PRIMASK,
        Register::Basepri => RegisterARM::BASEPRI,
        Register::Faultmask => RegisterARM::FAULTMASK,
        Register::Control => RegisterARM::CONTROL,
    };
    name as i32
}

impl Cpu for UnicornCpu {
    fn register(&self, register: Register) -> u32 {
        self.engine.reg_read(name(register)).unwrap_or(0) as u32
    }

    fn set_register(&mut self, register: Register, value: u32) {
        // Every name of ours is one of the engine's.
        let _ = self.engine.reg_write(name(register), value.into());
    }

    fn read(&self, address: u32, into: &mut [u8]) -> Result<(), NoMemory> {
        let read = self.engine.mem_read(address.into(), into);
        read.map_err(|_| NoMemory { address })
    }

    fn write(&mut self, address: u32, bytes: &[u8]) -> Result<(), NoMemory> {
        let written = self.engine.mem_write(address.into(), bytes);
        written.map_err(|_| NoMemory { address })
    }

    fn run(&mut self) -> Stop {
        loop {
            self.put_flash_right();
            let at = self.register(Register::Pc) | 1;
            let shared = self.engine.get_data_mut();
            shared.stop = None;
            shared.fresh = true;
            let ended = self.engine.emu_start(at.into(), 0, 0, 0);
            let stop = self.stopped(ended);
            if stop != Stop::Wanted || self.chip().wants_stop() || interrupted(&self.engine) {
                self.put_flash_right();
                return stop;
            }
        }
    }

    fn chip(&self) -> &Chip {
        &self.engine.get_data().chip
    }

    fn chip_mut(&mut self) -> &mut Chip {
        &mut self.engine.get_data_mut().chip
    }
}

#[cfg(test)]
mod tests;
