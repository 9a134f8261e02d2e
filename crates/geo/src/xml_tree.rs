//! Small XML files as trees: VRT and PAM.

use std::path::Path;

use grimnet_limits::MapLimits;
use quick_xml::Reader;
use quick_xml::events::{BytesStart, Event};

use crate::GeoError;

/// Elements in elements, at most.
const MAX_DEPTH: usize = 32;
/// Largest file, bytes.
const MAX_BYTES: u64 = MapLimits::DEFAULT.max_description_bytes;

/// An element with what is in it.
#[derive(Debug, Default, Clone, PartialEq)]
pub(crate) struct Element {
    pub name: String,
    attributes: Vec<(String, String)>,
    /// Text directly in it, entities resolved.
    pub text: String,
    pub children: Vec<Element>,
}

impl Element {
    /// The value of an attribute.
    pub fn attribute(&self, name: &str) -> Option<&str> {
        let found = self.attributes.iter().find(|(n, _)| n == name)?;
        Some(&found.1)
    }

    /// Elements of this name directly in it.
    pub fn all<'a>(&'a self, name: &'a str) -> impl Iterator<Item = &'a Element> {
        self.children.iter().filter(move |e| e.name == name)
    }

    /// The first element of this name directly in it.
    pub fn child(&self, name: &str) -> Option<&Element> {
        self.children.iter().find(|e| e.name == name)
    }

    /// The text of the first element of this name, without spaces around it.
    pub fn child_text(&self, name: &str) -> Option<&str> {
        self.child(name).map(|e| e.text.trim())
    }
}

/// Reads a file.
pub(crate) fn read_xml(path: &Path) -> Result<Element, GeoError> {
    let length = std::fs::metadata(path)
        .map_err(|e| GeoError::io(path, e))?
        .len();
    if length > MAX_BYTES {
        return Err(GeoError::damaged(path, format!("it has {length} bytes")));
    }
    let bytes = std::fs::read(path).map_err(|e| GeoError::io(path, e))?;
    parse(&String::from_utf8_lossy(&bytes)).map_err(|reason| GeoError::damaged(path, reason))
}

fn parse(text: &str) -> Result<Element, String> {
    let mut reader = Reader::from_str(text);
    // The root is put into an element of its own.
    let mut open = vec![Element::default()];
    loop {
        let event = reader
            .read_event()
            .map_err(|e| format!("not well-formed XML: {e}"))?;
        match event {
            Event::Start(start) => {
                if open.len() > MAX_DEPTH {
                    return Err(format!(
                        "its elements are nested more than {MAX_DEPTH} deep"
                    ));
                }
                open.push(element_of(&start)?);
            }
            Event::Empty(start) => {
                let element = element_of(&start)?;
                add(&mut open, element);
            }
            Event::End(_) => {
                if let Some(element) = open.pop() {
                    add(&mut open, element);
                }
            }
            Event::Text(piece) => push_text(&mut open, &piece),
            Event::CData(piece) => push_text(&mut open, &piece),
            Event::GeneralRef(reference) => {
                if let Ok(Some(character)) = reference.resolve_char_ref() {
                    push_text(&mut open, character.encode_utf8(&mut [0; 4]));
                } else if let Some(known) = quick_xml::escape::resolve_xml_entity(&reference) {
                    push_text(&mut open, known);
                }
            }
            Event::Eof => break,
            _ => {}
        }
    }
    let [root] = open.as_mut_slice() else {
        return Err("it ends within an element".to_string());
    };
    root.children
        .pop()
        .ok_or_else(|| "it has no elements".to_string())
}

fn add(open: &mut [Element], element: Element) {
    if let Some(parent) = open.last_mut() {
        parent.children.push(element);
    }
}

fn push_text(open: &mut [Element], text: &str) {
    if let Some(parent) = open.last_mut() {
        parent.text.push_str(text);
    }
}

fn element_of(start: &BytesStart) -> Result<Element, String> {
    let mut attributes = Vec::new();
    for attribute in start.attributes() {
        let attribute = attribute.map_err(|e| format!("not well-formed XML: {e}"))?;
        let value = quick_xml::escape::unescape(&attribute.value)
            .map_err(|e| format!("not well-formed XML: {e}"))?;
        attributes.push((attribute.key.0.to_string(), value.into_owned()));
    }
    Ok(Element {
        name: start.name().0.to_string(),
        attributes,
        ..Element::default()
    })
}
