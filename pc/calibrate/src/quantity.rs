//! Quantities in a certificate: names, numbers, and numbers with their unit.
//!
//! In: the document on its way (`xml`), and numbers. Out: the elements `dcc:name`, `dcc:quantity`,
//! `si:real` and `si:realListXMLList` of the format (DCC 3.2.1, D-SI 2).
//!
//! Left out: what a certificate consists of (`dcc`).

use super::xml::Xml;

/// Metre per second squared, as the format writes it (SIunitx).
pub const METRE_PER_SECOND2: &str = "\\metre\\second\\tothe{-2}";

/// m/s^2 of a mg: the format has no g.
pub const SI_PER_MG: f64 = 9.806_65e-3;

/// A name in English.
pub fn name(xml: &mut Xml, text: &str) {
    xml.of("dcc:name", |xml| content(xml, text));
}

/// Text in English.
pub fn content(xml: &mut Xml, text: &str) {
    xml.text("dcc:content", &[("lang", "en")], text);
}

/// A number with its unit.
pub fn real(xml: &mut Xml, what: &str, value: f64, unit: &str) {
    xml.of("dcc:quantity", |xml| {
        name(xml, what);
        xml.of("si:real", |xml| {
            xml.text("si:value", &[], &decimal(value));
            xml.text("si:unit", &[], unit);
        });
    });
}

/// Numbers with their unit, and with their expanded uncertainty (k = 2) where it is known.
pub fn list(xml: &mut Xml, what: &str, values: &[f64], unit: &str, expanded: Option<f64>) {
    xml.of("dcc:quantity", |xml| {
        name(xml, what);
        xml.of("si:realListXMLList", |xml| {
            let words: Vec<_> = values.iter().map(|value| decimal(*value)).collect();
            xml.text("si:valueXMLList", &[], &words.join(" "));
            xml.text("si:unitXMLList", &[], unit);
            if let Some(expanded) = expanded {
                xml.of("si:expandedUncXMLList", |xml| {
                    xml.text("si:uncertaintyXMLList", &[], &decimal(expanded));
                    xml.text("si:coverageFactorXMLList", &[], "2");
                    xml.text("si:coverageProbabilityXMLList", &[], "0.95");
                    xml.text("si:distributionXMLList", &[], "normal");
                });
            }
        });
    });
}

/// A result with its name and its data.
pub fn result_of(xml: &mut Xml, what: &str, data: impl FnOnce(&mut Xml)) {
    xml.of("dcc:result", |xml| {
        name(xml, what);
        xml.of("dcc:data", data);
    });
}

/// A result whose data are lists of the same length.
pub fn result_of_lists(xml: &mut Xml, what: &str, lists: impl FnOnce(&mut Xml)) {
    result_of(xml, what, |xml| xml.of("dcc:list", lists));
}

/// A number with six decimals, and no minus before zero.
fn decimal(value: f64) -> String {
    let text = format!("{value:.6}");
    match text.strip_prefix('-') {
        Some(rest) if rest.chars().all(|c| c == '0' || c == '.') => rest.to_owned(),
        _ => text,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_no_minus_before_zero() {
        assert_eq!(decimal(-0.000_000_1), "0.000000");
        assert_eq!(decimal(-1.5), "-1.500000");
    }
}
