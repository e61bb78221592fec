//! A strict writer of XML: elements, attributes and escaped text, nothing else.
//!
//! In: names from the program and text from anywhere. Out: a document that every parser
//! takes. Characters that XML 1.0 does not allow become spaces.
//!
//! Left out: reading, comments, CDATA, processing instructions.

use output::html;

/// A document on its way.
#[derive(Debug)]
pub struct Xml {
    text: String,
    open: Vec<&'static str>,
}

/// Text between tags, or in an attribute in double quotes. An apostrophe is safe there and stays:
/// certificates of all releases have the same bytes.
fn escape(text: &str) -> String {
    html::escape(text).replace("&#39;", "'")
}

impl Xml {
    /// A document in UTF-8 without content.
    pub fn new() -> Self {
        Self {
            text: "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n".to_owned(),
            open: Vec::new(),
        }
    }

    fn indent(&mut self) {
        self.text.extend(self.open.iter().map(|_| "  "));
    }

    fn tag(&mut self, name: &str, attributes: &[(&str, &str)]) {
        self.text.push('<');
        self.text.push_str(name);
        for (key, value) in attributes {
            self.text.push_str(&format!(" {key}=\"{}\"", escape(value)));
        }
        self.text.push('>');
    }

    /// An element that holds what `content` writes.
    pub fn element(
        &mut self,
        name: &'static str,
        attributes: &[(&str, &str)],
        content: impl FnOnce(&mut Self),
    ) {
        self.indent();
        self.tag(name, attributes);
        self.text.push('\n');
        self.open.push(name);
        content(self);
        self.open.pop();
        self.indent();
        self.text.push_str(&format!("</{name}>\n"));
    }

    /// The same without attributes.
    pub fn of(&mut self, name: &'static str, content: impl FnOnce(&mut Self)) {
        self.element(name, &[], content);
    }

    /// An element that holds text. Space around it is taken away, and runs of it are one.
    pub fn text(&mut self, name: &'static str, attributes: &[(&str, &str)], text: &str) {
        self.indent();
        self.tag(name, attributes);
        let words: Vec<_> = escape(text).split_whitespace().map(str::to_owned).collect();
        self.text.push_str(&words.join(" "));
        self.text.push_str(&format!("</{name}>\n"));
    }

    /// The document.
    pub fn finish(self) -> String {
        self.text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_from_anywhere_stays_text() {
        let mut xml = Xml::new();
        xml.element("a", &[("b", "\"<&")], |xml| {
            xml.text("c", &[], " </c>\u{0}\u{1b}x \n y\u{FFFF}");
        });
        let want = "<a b=\"&quot;&lt;&amp;\">\n  <c>&lt;/c&gt; x y</c>\n</a>\n";
        assert!(xml.finish().ends_with(want));
    }
}
