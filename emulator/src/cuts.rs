//! What the flash holds when the supply fails in an operation: for every operation of a run.
//!
//! In: the cells before a run, and the journal of what its code did to them. Out: for each
//! operation the cells as a cut in its middle leaves them. A core that has lost its supply does
//! nothing more, so these are exactly the cells that a run with the cut would leave, and one run
//! gives them all.
//!
//! Left out: what else a loss of supply leaves (RAM, registers, the sensor).

use flash::nor::NorError;

use crate::chip::flash_controller::{Cells, Dice, Operation};

/// The cuts of one run, in the order of its operations.
#[derive(Debug)]
pub struct Cuts<'a> {
    cells: Cells,
    journal: &'a [Operation],
    done: usize,
}

impl<'a> Cuts<'a> {
    /// The run that began with these cells and did these operations.
    pub fn new(before: Cells, journal: &'a [Operation]) -> Self {
        Self {
            cells: before,
            journal,
            done: 0,
        }
    }

    /// The cells that a cut in operation `number` leaves, without power; `seed` sets which bits of
    /// it are done. Ask in rising order.
    ///
    /// # Panics
    /// When there is no such operation, or it was passed already.
    pub fn at(&mut self, number: usize, seed: u64) -> Cells {
        self.go_to(number);
        let mut cells = self.cells.clone();
        let stream = (number as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15);
        cells.set_draw(Dice::new(seed ^ stream));
        cells.cut_after(0);
        let cut = self.journal[number].run(&mut cells);
        assert_eq!(cut, Err(NorError::NoPower), "operation {number}");
        cells
    }

    /// The cells when all of it was done.
    ///
    /// # Panics
    /// When the journal is not of these cells.
    pub fn end(mut self) -> Cells {
        self.go_to(self.journal.len());
        self.cells
    }

    fn go_to(&mut self, number: usize) {
        assert!(self.done <= number, "operation {number} was passed");
        for operation in &self.journal[self.done..number] {
            let done = operation.run(&mut self.cells);
            done.expect("the code did it to the same cells");
        }
        self.done = number;
    }
}

#[cfg(test)]
mod tests {
    use flash::layout::PAGE;
    use flash::nor::{Nor, Page};

    use super::*;

    #[test]
    fn a_cut_leaves_what_was_before_done_and_what_comes_after_undone() {
        let cells = Nor::new(vec![Page::new(); 2], Dice::new(1));
        let journal = [
            Operation::Program(0, [1, 2]),
            Operation::Program(2, [0, 0]),
            Operation::Erase(PAGE),
            Operation::Program(4, [5, 6]),
        ];
        let mut cuts = Cuts::new(cells, &journal);
        let mut seen = Vec::new();
        for number in [1, 2, 3] {
            let cells = cuts.at(number, 7);
            assert!(cells.is_cut());
            let [page, erased] = cells.pages() else {
                panic!("two pages");
            };
            assert_eq!(page.bytes()[..2], [1, 2]);
            assert_eq!(erased.erases(), u32::from(number >= 2));
            seen.push([page.bytes()[2], page.bytes()[4]]);
        }
        // Only the operation in which it fails is half done.
        assert_ne!(seen[0][0], 0);
        assert_eq!([seen[1], [seen[2][0], 0]], [[0, 0xFF], [0, 0]]);
        assert_eq!(cuts.end().pages()[0].bytes()[..6], [1, 2, 0, 0, 5, 6]);
    }
}
