//! Unicorn's Cortex-M3, with what it needs to behave as one: what the emulator's own is held to.
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
//! one; and the fault that LDM, STM, LDRD and STRD end in at an address that is not aligned, which
//! the engine carries out.

use std::ffi::{c_int, c_void};
use std::fmt;
use std::ptr::NonNull;

use flash::layout::{BASE, RAM};
use unicorn_engine::hook::sys;
use unicorn_engine::{
    Arch, ArmCpuModel, HookType, MemType, Mode, Prot, RegisterARM, TlbEntry, TlbType, Unicorn,
    uc_error,
};

use emulator::chip::{Chip, bit_band};
use emulator::code::{Block, WFE, WFI, YIELD};
use emulator::cpu::{ALIAS, Cpu, Fault, NoMemory, Register, Stop};
use emulator::exceptions::{IT_STATE, Masks};

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
    /// What the core sees of the flash, at both of its places.
    flash: Box<[u8]>,
    /// Why the core is to stop; noted by a hook.
    stop: Option<Stop>,
    /// The block under way.
    block: (u32, u32),
    /// The cycle at which the core was started: while it is that, no block has begun.
    started: u64,
}

impl Shared {
    /// Notes why the core is to stop, if nothing was noted before.
    fn note(&mut self, stop: Stop) {
        self.stop.get_or_insert(stop);
        self.chip.call();
    }
}

/// Keeps what is shared where both find it: the hooks of the engine, and the hook before each
/// block, which gets a pointer from the engine and nothing else.
#[derive(Debug)]
struct Keeper(NonNull<Shared>);

impl Keeper {
    fn new(shared: Shared) -> Self {
        Self(NonNull::from(Box::leak(Box::new(shared))))
    }

    fn get(&self) -> &Shared {
        // SAFETY: it lives until the keeper is dropped, and `get_mut` and the hook, which alone
        // change it, do so while nobody holds what this returns: all run on one thread, and
        // nothing is held while the engine runs.
        unsafe { self.0.as_ref() }
    }

    fn get_mut(&mut self) -> &mut Shared {
        // SAFETY: as in `get`.
        unsafe { self.0.as_mut() }
    }
}

impl Drop for Keeper {
    fn drop(&mut self) {
        // SAFETY: it came out of a box and is dropped once; the engine, which is gone with the
        // keeper, does not call its hooks while it goes.
        drop(unsafe { Box::from_raw(self.0.as_ptr()) });
    }
}

type Engine = Unicorn<'static, Keeper>;
/// What the engine calls before a block: with itself, address, size, and what the hook was given.
type BlockHook = unsafe extern "C" fn(*mut sys::uc_engine, u64, u32, *mut c_void);

/// Unicorn with a chip around it.
pub struct UnicornCpu {
    engine: Engine,
}

impl fmt::Debug for UnicornCpu {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("UnicornCpu")
            .field("shared", self.engine.get_data().get())
            .finish()
    }
}

impl UnicornCpu {
    fn stopped(&mut self, ended: Result<(), uc_error>) -> Stop {
        let noted = self.engine.get_data_mut().get_mut().stop.take();
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

    fn interrupted(&self) -> bool {
        let read = |register: RegisterARM| self.engine.reg_read(register).unwrap_or(0) as u32;
        interrupted(self.chip(), read)
    }

    /// The half-word before `at`, where the block under way ends with it.
    fn hint_before(&self, at: u32) -> u16 {
        let (begin, size) = self.engine.get_data().get().block;
        let mut half_word = [0; 2];
        let ended = begin.wrapping_add(size) == at && size >= 2;
        match ended && self.read(at.wrapping_sub(2), &mut half_word).is_ok() {
            true => u16::from_le_bytes(half_word),
            false => 0,
        }
    }

    /// Takes back what was counted of a block that ended early, at `at`.
    fn take_back(&mut self, at: u32) {
        let (begin, size) = self.engine.get_data().get().block;
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
            self.engine.get_data_mut().get_mut().chip.take_back(count);
        }
    }
}

fn build(shared: Shared, flash: u32, ram: u32) -> Result<Engine, uc_error> {
    let mut engine = Unicorn::new_with_data(Arch::ARM, Mode::THUMB, Keeper::new(shared))?;
    engine.ctl_set_cpu_model(ArmCpuModel::CORTEX_M3 as i32)?;
    engine.ctl_exits_enable()?;
    let read_only = Prot::READ | Prot::EXEC;
    for base in [BASE, ALIAS] {
        let cells = engine.get_data_mut().get_mut().flash.as_mut_ptr();
        // SAFETY: the memory is as long as that, is there until the engine has gone, and is never
        // looked at but through the engine.
        unsafe { engine.mem_map_ptr(base.into(), flash.into(), read_only, cells.cast())? };
    }
    // The engine watches a page for code that changes, at each store, unless there can be none.
    engine.mem_map(RAM.into(), ram.into(), Prot::READ | Prot::WRITE)?;
    for (base, size) in MMIO.into_iter().chain([PRIVATE]) {
        map_registers(&mut engine, base, size)?;
    }
    engine.ctl_set_tlb_type(TlbType::VIRTUAL)?;
    engine.add_tlb_hook(1, 0, |engine, page, kind| {
        // A fetch is between two blocks, and there may be an IT block that goes on.
        if kind != MemType::FETCH {
            leave_it_block(engine);
        }
        Some(translation(page as u32))
    })?;
    add_block_hook(&mut engine)?;
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
                leave_it_block(engine);
                let chip = &mut engine.get_data_mut().get_mut().chip;
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
fn leave_it_block(engine: &mut Unicorn<'_, Keeper>) {
    let xpsr = engine.reg_read(RegisterARM::XPSR).unwrap_or(0);
    if xpsr as u32 & IT_STATE != 0 {
        let _ = engine.reg_write(RegisterARM::XPSR, xpsr & !u64::from(IT_STATE));
    }
}

/// Notes a load, a store or a fetch where nothing is; false, since nobody has handled it.
fn note_unmapped(engine: &mut Unicorn<'_, Keeper>, kind: MemType, address: u32) -> bool {
    let stop = match kind {
        MemType::FETCH_UNMAPPED if address >= EXC_RETURN => Stop::ExceptionReturn(address | 1),
        MemType::FETCH_UNMAPPED => Stop::Fault(Fault::Fetch { address }),
        _ => Stop::Fault(Fault::Bus { address }),
    };
    engine.get_data_mut().get_mut().note(stop);
    false
}

fn map_registers(engine: &mut Engine, base: u32, size: u32) -> Result<(), uc_error> {
    engine.mmio_map(
        base.into(),
        size.into(),
        Some(
            move |engine: &mut Unicorn<'_, Keeper>, offset: u64, size: usize| {
                let address = base.wrapping_add(offset as u32);
                if let Some((byte, bit)) = bit_band::in_ram(address) {
                    let mut value = [0];
                    let _ = engine.mem_read(byte.into(), &mut value);
                    return u64::from(value[0] >> bit & 1);
                }
                u64::from(
                    engine
                        .get_data_mut()
                        .get_mut()
                        .chip
                        .read(address, size as u32),
                )
            },
        ),
        Some(
            move |engine: &mut Unicorn<'_, Keeper>, offset: u64, size: usize, value: u64| {
                let address = base.wrapping_add(offset as u32);
                if let Some((byte, bit)) = bit_band::in_ram(address) {
                    let mut held = [0];
                    let _ = engine.mem_read(byte.into(), &mut held);
                    let set = ((value & 1) as u8) << bit;
                    let _ = engine.mem_write(byte.into(), &[held[0] & !(1 << bit) | set]);
                    return;
                }
                let chip = &mut engine.get_data_mut().get_mut().chip;
                chip.write(address, size as u32, value as u32);
            },
        ),
    )
}

/// Has [`on_block`] called before each block of code.
///
/// The crate's own way to do so costs three times what the counting takes: it looks up the engine
/// anew each time.
fn add_block_hook(engine: &mut Engine) -> Result<(), uc_error> {
    let shared: *mut Shared = engine.get_data_mut().0.as_ptr();
    let mut id = 0;
    // SAFETY: the callback is of the type that the engine calls hooks of blocks by, and what it is
    // given lives as long as the engine does.
    let added = unsafe {
        sys::uc_hook_add(
            engine.get_handle(),
            &mut id,
            HookType::BLOCK.0 as c_int,
            on_block as BlockHook as *mut c_void,
            shared.cast(),
            1u64,
            0u64,
        )
    };
    match added {
        uc_error::OK => Ok(()),
        error => Err(error),
    }
}

/// Counts a block, or stops before it.
unsafe extern "C" fn on_block(
    engine: *mut sys::uc_engine,
    address: u64,
    size: u32,
    shared: *mut c_void,
) {
    // SAFETY: it is what `add_block_hook` has given, and nobody holds it while the engine runs.
    let shared = unsafe { &mut *shared.cast::<Shared>() };
    if shared.chip.needs_attention() && attend(shared, engine) {
        return;
    }
    shared.block = (address as u32, size);
    let mut bytes = vec![0u8; size as usize];
    // SAFETY: the engine runs, and there is room for so many bytes.
    let _ = unsafe {
        let into = bytes.as_mut_ptr().cast();
        sys::uc_mem_read(engine, address, into, size.into())
    };
    let block = Block::of(&bytes);
    if shared.chip.is_observed() {
        shared.chip.observe(address as u32, block, &bytes);
    }
    shared.chip.begin(block);
}

/// Lets the chip come to now; true when the core stops before the block.
fn attend(shared: &mut Shared, engine: *mut sys::uc_engine) -> bool {
    if shared.stop.is_some() {
        return true;
    }
    // The first block after a start is let through.
    if shared.chip.cycles() == shared.started {
        return false;
    }
    shared.chip.attend();
    let read = |register: RegisterARM| {
        let mut value = 0u32;
        // SAFETY: the engine runs, and a register of this core has 32 bits.
        let read = unsafe { sys::uc_reg_read(engine, register as c_int, (&raw mut value).cast()) };
        debug_assert_eq!(read, uc_error::OK);
        value
    };
    let stops = shared.chip.wants_stop() || interrupted(&shared.chip, read);
    if stops {
        // The chip's own stop counts with no block begun.
        shared.note(Stop::Wanted);
        // SAFETY: the engine runs and may be stopped from its hooks.
        let _ = unsafe { sys::uc_emu_stop(engine) };
    }
    stops
}

/// Whether an exception is to be taken here.
fn interrupted(chip: &Chip, read: impl Fn(RegisterARM) -> u32) -> bool {
    let Some(waiting) = chip.nvic.first() else {
        return false;
    };
    let masks = Masks {
        primask: read(RegisterARM::PRIMASK) != 0,
        faultmask: read(RegisterARM::FAULTMASK) != 0,
        basepri: read(RegisterARM::BASEPRI) as u8,
    };
    // Inside of an IT block the engine cannot be sent elsewhere.
    masks.let_through(waiting, &chip.nvic) && read(RegisterARM::XPSR) & IT_STATE == 0
}

/// An exception that the engine raises: notes it, and stops.
fn on_interrupt(engine: &mut Unicorn<'_, Keeper>, number: u32) {
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
    engine.get_data_mut().get_mut().note(stop);
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
    fn new(chip: Chip) -> Self {
        let (flash, ram) = (chip.flash_size(), chip.ram_size());
        let shared = Shared {
            chip,
            flash: vec![0; flash as usize].into(),
            stop: None,
            block: (0, 0),
            started: 0,
        };
        let engine = build(shared, flash, ram);
        Self {
            engine: engine.expect("the engine needs memory, and nothing else can fail"),
        }
    }

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
            let shared = self.engine.get_data_mut().get_mut();
            shared.stop = None;
            shared.started = shared.chip.cycles();
            shared.chip.call();
            let ended = self.engine.emu_start(at.into(), 0, 0, 0);
            let stop = self.stopped(ended);
            if stop != Stop::Wanted || self.chip().wants_stop() || self.interrupted() {
                self.put_flash_right();
                return stop;
            }
        }
    }

    fn chip(&self) -> &Chip {
        &self.engine.get_data().get().chip
    }

    fn chip_mut(&mut self) -> &mut Chip {
        &mut self.engine.get_data_mut().get_mut().chip
    }
}
