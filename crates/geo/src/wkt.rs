//! Well-known text of coordinate systems (OGC 01-009 and 12-063, ESRI's variant) as a tree.

/// Nodes in nodes, at most.
const MAX_DEPTH: usize = 32;

/// Roots of coordinate systems of the plane and of the ellipsoid, WKT 1 and 2.
const SYSTEMS: [&str; 6] = [
    "PROJCS",
    "PROJCRS",
    "GEOGCS",
    "GEOGCRS",
    "GEODCRS",
    "GEODETICCRS",
];

/// A keyword and what is in its brackets.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct WktNode {
    pub keyword: String,
    values: Vec<WktValue>,
}

#[derive(Debug, Clone, PartialEq)]
enum WktValue {
    Node(WktNode),
    /// A number, a word or a text without its quotation marks.
    Text(String),
}

impl WktNode {
    /// Reads a text; `None` if it is not well-formed. What follows the first node is left out.
    pub fn parse(text: &str) -> Option<Self> {
        match (Reader { rest: text }).value(0)? {
            WktValue::Node(node) => Some(node),
            WktValue::Text(_) => None,
        }
    }

    /// The system of the plane or of the ellipsoid that it is, or the first one that it holds: compound and bound systems hold one.
    pub fn system(&self) -> Option<&Self> {
        if SYSTEMS.contains(&self.keyword.as_str()) {
            return Some(self);
        }
        self.nodes().find_map(Self::system)
    }

    /// Its EPSG code: `AUTHORITY["EPSG","25832"]` or `ID["EPSG",25832]` directly in it.
    pub fn epsg(&self) -> Option<u32> {
        let mut codes = self
            .nodes()
            .filter(|node| node.keyword == "AUTHORITY" || node.keyword == "ID");
        let code = codes.find(|node| node.text(0) == Some("EPSG"))?;
        code.text(1)?.parse().ok()
    }

    /// The nodes directly in it.
    pub fn nodes(&self) -> impl Iterator<Item = &Self> {
        self.values.iter().filter_map(|value| match value {
            WktValue::Node(node) => Some(node),
            WktValue::Text(_) => None,
        })
    }

    /// The first node of this keyword directly in it.
    pub fn node(&self, keyword: &str) -> Option<&Self> {
        self.nodes().find(|node| node.keyword == keyword)
    }

    /// A number, word or text directly in it; the name is the first.
    pub fn text(&self, index: usize) -> Option<&str> {
        match self.values.get(index)? {
            WktValue::Text(text) => Some(text),
            WktValue::Node(_) => None,
        }
    }

    /// A finite number directly in it.
    pub fn number(&self, index: usize) -> Option<f64> {
        let number: f64 = self.text(index)?.parse().ok()?;
        number.is_finite().then_some(number)
    }
}

struct Reader<'a> {
    rest: &'a str,
}

impl Reader<'_> {
    fn value(&mut self, depth: usize) -> Option<WktValue> {
        self.rest = self.rest.trim_start();
        if self.rest.starts_with('"') {
            return self.quoted().map(WktValue::Text);
        }
        let end = self
            .rest
            .find(['[', '(', ']', ')', ',', '"'])
            .unwrap_or(self.rest.len());
        let (word, rest) = self.rest.split_at(end);
        let word = word.trim().to_string();
        self.rest = rest;
        if !self.take(&['[', '(']) {
            return (!word.is_empty()).then_some(WktValue::Text(word));
        }
        if depth >= MAX_DEPTH || word.is_empty() {
            return None;
        }
        let mut values = Vec::new();
        loop {
            values.push(self.value(depth + 1)?);
            if self.take(&[']', ')']) {
                let keyword = word.to_ascii_uppercase();
                return Some(WktValue::Node(WktNode { keyword, values }));
            }
            if !self.take(&[',']) {
                return None;
            }
        }
    }

    /// A text in quotation marks; two of them stand for one.
    fn quoted(&mut self) -> Option<String> {
        let mut text = String::new();
        while let Some(rest) = self.rest.strip_prefix('"') {
            let end = rest.find('"')?;
            if !text.is_empty() {
                text.push('"');
            }
            text.push_str(&rest[..end]);
            self.rest = &rest[end + 1..];
        }
        Some(text)
    }

    /// Whether one of these characters comes next; it is passed.
    fn take(&mut self, characters: &[char]) -> bool {
        let rest = self.rest.trim_start();
        let after = rest.strip_prefix(characters);
        self.rest = after.unwrap_or(rest);
        after.is_some()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn epsg_of(text: &str) -> Option<u32> {
        WktNode::parse(text)?.system()?.epsg()
    }

    #[test]
    fn the_code_is_that_of_the_outermost_system() {
        let utm = r#"PROJCS["WGS 84 / UTM, [zone] 32N",GEOGCS["WGS 84",AUTHORITY["EPSG","4326"]],UNIT["m",1],AUTHORITY["EPSG","32632"]]"#;
        assert_eq!(epsg_of(utm), Some(32632));
        let wkt2 = r#"PROJCRS["x", BASEGEOGCRS["WGS 84", ID["EPSG", 4326]], ID["EPSG", 25832]]"#;
        assert_eq!(epsg_of(wkt2), Some(25832));
        let compound = r#"COMPD_CS["x",PROJCS["p",GEOGCS["g",AUTHORITY["EPSG","4258"]],AUTHORITY["EPSG","25833"]],VERT_CS["v",AUTHORITY["EPSG","7837"]],AUTHORITY["EPSG","1"]]"#;
        assert_eq!(epsg_of(compound), Some(25833));
        let without = r#"PROJCS["own",GEOGCS["WGS 84",AUTHORITY["EPSG","4326"]],UNIT["m",1]]"#;
        assert_eq!(epsg_of(without), None);
    }

    #[test]
    fn texts_in_quotation_marks_may_hold_anything() {
        let node = WktNode::parse(r#"projcs ( "a ""b"", [c]" , UNIT [ "m" , 1.5e0 ] )"#).unwrap();
        assert_eq!(node.keyword, "PROJCS");
        assert_eq!(node.text(0), Some(r#"a "b", [c]"#));
        assert_eq!(node.node("UNIT").unwrap().number(1), Some(1.5));
    }

    #[test]
    fn broken_texts_are_none() {
        let deep = "A[".repeat(100_000);
        for broken in [
            "",
            "PROJCS",
            "PROJCS[",
            "PROJCS[]]]",
            "PROJCS[\"",
            "]",
            "PROJCS[\"a\" UNIT[1]]",
            "PROJCS[AUTHORITY[",
            "PROJCS[ID[]",
            &deep,
        ] {
            assert_eq!(WktNode::parse(broken), None, "{broken}");
        }
    }
}
