//! A table that declares words: how each is written, what it does, and how the rest is read.
//!
//! In: the rows. Out: their names, their help, and the value of a line, all from the same rows.
//!
//! Left out: the rows themselves (`line`, `trouble`).

use super::reader::{Read, Reader, WordError};

/// One word.
#[derive(Debug)]
pub struct Row<T> {
    /// How all of it is written.
    pub form: &'static str,
    does: &'static str,
    read: fn(&mut Reader<'_>) -> Read<T>,
}

/// A word that is written so, does this, and whose rest is read so.
pub const fn row<T>(
    form: &'static str,
    does: &'static str,
    read: fn(&mut Reader<'_>) -> Read<T>,
) -> Row<T> {
    Row { form, does, read }
}

/// Words of one kind.
#[derive(Debug)]
pub struct Table<T: 'static> {
    /// What they are.
    pub what: &'static str,
    /// What stands before the name in each form.
    pub before: &'static str,
    /// One for each.
    pub rows: &'static [Row<T>],
}

impl<T> Table<T> {
    fn name(&self, row: &Row<T>) -> &'static str {
        let rest = row.form.strip_prefix(self.before).unwrap_or(row.form);
        rest.split_once(' ').map_or(rest, |(name, _)| name)
    }

    /// The names of all words.
    pub fn names(&self) -> impl Iterator<Item = &'static str> {
        self.rows.iter().map(|row| self.name(row))
    }

    /// All words with what they do, a line each.
    pub fn help(&self) -> String {
        let line = |row: &Row<T>| format!("  {}: {}\n", row.form, row.does);
        self.rows.iter().map(line).collect()
    }

    /// Reads a name and all that stands behind it.
    ///
    /// Errors: [`WordError::Unknown`], and those of the row.
    pub fn read(&self, reader: &mut Reader<'_>) -> Read<T> {
        let name = reader.next().unwrap_or_default();
        let row = self.rows.iter().find(|row| self.name(row) == name);
        let row = row.ok_or_else(|| WordError::Unknown {
            what: self.what,
            name: name.to_owned(),
            known: self.names().collect::<Vec<_>>().join(", "),
        })?;
        reader.form = row.form;
        let value = (row.read)(reader)?;
        match reader.is_over() {
            true => Ok(value),
            false => Err(reader.bad()),
        }
    }

    /// The name of what has this value without anything behind it.
    pub fn name_of(&self, value: &T) -> Option<&'static str>
    where
        T: PartialEq,
    {
        let alone = |row: &Row<T>| (row.read)(&mut Reader::new("", &[], 0)).ok();
        let row = self
            .rows
            .iter()
            .find(|row| alone(row).as_ref() == Some(value));
        row.map(|row| self.name(row))
    }
}
