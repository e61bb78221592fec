//! Whose updates a node will believe, in a sentence.
//!
//! In: `PLUMB_KEY` and `PLUMB_UNSIGNED`, as the firmware's build script takes them. Out: what the
//! person who builds should know before anything is flashed, or what is wrong with them.

/// What the images that are built now believe; `variable` looks a variable up.
///
/// Errors: a sentence for each value that is none.
pub fn believed(variable: impl Fn(&str) -> Option<String>) -> Result<String, String> {
    let key = match variable("PLUMB_KEY") {
        Some(key) if key.len() != 64 || !key.bytes().all(|digit| digit.is_ascii_hexdigit()) => {
            return Err(format!(
                "PLUMB_KEY is {key:?}: set it to the 64 hexadecimal digits of a public key"
            ));
        }
        key => key.filter(|key| key.bytes().any(|digit| digit != b'0')),
    };
    match (variable("PLUMB_UNSIGNED").as_deref(), key) {
        (None | Some("" | "0"), Some(key)) => Ok(format!("accepts updates signed by {key}")),
        (None | Some("" | "0"), None) => Ok(
            "accepts no update over the bus: PLUMB_KEY names nobody (docs/canopen.md, your key)"
                .to_owned(),
        ),
        (Some("1"), _) => Ok("TAKES ANY IMAGE, signed or not: PLUMB_UNSIGNED is 1".to_owned()),
        (Some(other), _) => Err(format!("PLUMB_UNSIGNED is {other:?}: it can be 0 or 1")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn with(key: Option<&str>, unsigned: Option<&str>) -> Result<String, String> {
        believed(|name| {
            let value = if name == "PLUMB_KEY" { key } else { unsigned };
            value.map(str::to_owned)
        })
    }

    #[test]
    fn nobody_was_told_that_a_board_without_a_key_takes_no_update() {
        let key = "ab".repeat(32);
        assert!(with(Some(&key), None).unwrap().ends_with(&key));
        let zeros = "0".repeat(64);
        for nobody in [None, Some(zeros.as_str())] {
            let told = with(nobody, Some("0")).unwrap();
            assert!(told.contains("no update over the bus"), "{told}");
        }
        let told = with(None, Some("1")).unwrap();
        assert!(told.contains("ANY IMAGE"), "{told}");
        assert!(with(Some("zz"), None).unwrap_err().contains("PLUMB_KEY"));
        assert!(
            with(None, Some("yes"))
                .unwrap_err()
                .contains("PLUMB_UNSIGNED")
        );
    }
}
