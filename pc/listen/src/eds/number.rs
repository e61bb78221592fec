//! Numbers of an EDS.
//!
//! In: the text of a value. Out: a [`Number`], and whether it stands there as CiA 306 asks:
//! decimal, `0x` and digits, `0` and octal digits; `$NODEID` may be added to it.

/// A value that may depend on the node-id.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Number {
    /// What does not depend on it.
    pub plain: i64,
    /// Whether the node-id is added.
    pub plus_node: bool,
}

impl Number {
    /// Its value for a node.
    pub fn of(self, node_id: u8) -> i64 {
        self.plain.saturating_add(if self.plus_node {
            i64::from(node_id)
        } else {
            0
        })
    }
}

/// How a number is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Form {
    /// As the standard asks.
    Standard,
    /// In a way that is understood all the same.
    Understood,
}

/// The number of a text; `None` when it is none.
pub fn parse(text: &str) -> Option<(Number, Form)> {
    let mut form = Form::Standard;
    let mut text = text;
    if let Some((before, _comment)) = text.split_once([';']) {
        (text, form) = (before, Form::Understood);
    }
    let mut sum = Number::default();
    let mut any = false;
    for part in text.split('+') {
        let part = part.trim();
        if part.eq_ignore_ascii_case("$nodeid") {
            if sum.plus_node {
                return None;
            }
            sum.plus_node = true;
        } else {
            let (value, how) = literal(part)?;
            sum.plain = sum.plain.checked_add(value)?;
            if how == Form::Understood {
                form = how;
            }
        }
        any = true;
    }
    any.then_some((sum, form))
}

/// A number without a node-id.
fn literal(text: &str) -> Option<(i64, Form)> {
    let (sign, digits) = match text.strip_prefix('-') {
        Some(digits) => (-1, digits),
        None => (1, text),
    };
    let with = |radix, digits: &str| {
        // A sign would be taken by the conversion, and blanks would not.
        let plain = digits.bytes().all(|byte| byte.is_ascii_alphanumeric());
        let value = plain.then(|| u64::from_str_radix(digits, radix).ok())??;
        // 64 bits are kept as they are.
        Some(sign * (value as i64 & if sign < 0 { i64::MAX } else { -1 }))
    };
    let lower = digits.to_ascii_lowercase();
    if let Some(hex) = lower.strip_prefix("0x") {
        return Some((with(16, hex)?, Form::Standard));
    }
    if let Some(hex) = lower.strip_suffix('h') {
        return Some((with(16, hex)?, Form::Understood));
    }
    match lower.strip_prefix('0') {
        // `001` and `010` are octal by the standard; 8 and 9 tell that it was not meant so.
        Some(octal) if !octal.is_empty() => match with(8, octal) {
            Some(value) => Some((value, Form::Standard)),
            None => Some((with(10, &lower)?, Form::Understood)),
        },
        _ => match with(10, &lower) {
            Some(value) => Some((value, Form::Standard)),
            None => Some((with(16, &lower)?, Form::Understood)),
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_of_every_form() {
        let plain = |plain| Number {
            plain,
            plus_node: false,
        };
        let node = |plain| Number {
            plain,
            plus_node: true,
        };
        let cases = [
            ("10", plain(10), Form::Standard),
            ("-10", plain(-10), Form::Standard),
            ("0", plain(0), Form::Standard),
            ("0x1A", plain(26), Form::Standard),
            ("0X1a", plain(26), Form::Standard),
            ("001", plain(1), Form::Standard),
            ("010", plain(8), Form::Standard),
            ("08", plain(8), Form::Understood),
            ("1Ah", plain(26), Form::Understood),
            ("1A", plain(26), Form::Understood),
            ("5 ; five", plain(5), Form::Understood),
            ("0xFFFFFFFF", plain(0xFFFF_FFFF), Form::Standard),
            ("0xFFFFFFFFFFFFFFFF", plain(-1), Form::Standard),
            ("$NODEID+0x180", node(0x180), Form::Standard),
            ("0x180+$NODEID", node(0x180), Form::Standard),
            ("$NodeId + 0x40000180", node(0x4000_0180), Form::Standard),
            ("$NODEID", node(0), Form::Standard),
        ];
        for (text, number, form) in cases {
            assert_eq!(parse(text), Some((number, form)), "{text}");
        }
        for text in [
            "",
            "+",
            "x",
            "$NODEID+$NODEID",
            "1 2",
            "--1",
            "0x",
            "0x-1",
            "$NODE+1",
        ] {
            assert_eq!(parse(text), None, "{text}");
        }
    }
}
