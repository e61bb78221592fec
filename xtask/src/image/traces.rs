//! What of the machine that built a program stands in it.
//!
//! In: the bytes of a program, and folders of this machine. Out: each text in it that names such a
//! folder, or one in which people have their homes.
//!
//! Left out: names of people and machines that stand in no path.

use crate::tidy::hygiene::MACHINE_PATHS;

/// The shortest folder that is looked for: a shorter one would be found in words by chance.
const SHORTEST: usize = 4;

/// The texts in `bytes` that name one of `folders` or a home.
pub fn found(bytes: &[u8], folders: &[String]) -> Vec<String> {
    let folders = folders.iter().map(String::as_str);
    let folders = folders.filter(|folder| folder.len() >= SHORTEST);
    let looked_for: Vec<&str> = folders.chain(MACHINE_PATHS).collect();
    let printable = |byte: &u8| byte.is_ascii_graphic() || *byte == b' ';
    let texts = bytes.split(|byte| !printable(byte));
    let texts = texts.map(String::from_utf8_lossy);
    let traces = texts.filter(|text| looked_for.iter().any(|folder| text.contains(folder)));
    traces.map(String::from).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_of_the_machine_is_found_amid_code() {
        let bytes = b"\x00\xB5no key/opt/lee/crates/crc-3.4.0/src/lib.rs\x10\xBD";
        let folders = ["/opt/lee/crates".to_owned()];
        let text = "no key/opt/lee/crates/crc-3.4.0/src/lib.rs";
        assert_eq!(found(bytes, &folders), [text]);
        assert!(found(bytes, &[]).is_empty());
    }

    #[test]
    fn a_home_is_found_whoever_lives_there() {
        for home in MACHINE_PATHS {
            let text = format!("{home}lee/x.rs");
            assert_eq!(found(text.as_bytes(), &[]), [text]);
        }
        let names = b"ed25519-compact-2.6.0/src/sha512.rs\0device/src/lib.rs";
        assert!(found(names, &["/".to_owned()]).is_empty());
    }
}
