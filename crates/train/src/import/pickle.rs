//! The part of Python's pickle format (protocol 2 and its neighbours) that PyTorch's state dictionaries use. Nothing is ever
//! executed: a call becomes a tensor or a dictionary where it is one of the few known ones, and an opaque value otherwise.

use std::collections::HashMap;

/// A value on the pickle machine's stack.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Value {
    /// None, objects and whatever else carries no weights.
    Opaque,
    Bool(bool),
    Int(i64),
    Text(String),
    /// A class or function, as `module name`.
    Global(String),
    Sequence(Vec<Value>),
    Dict(Vec<(Value, Value)>),
    /// A reference to a storage: what the writer said about it.
    Storage(Vec<Value>),
    Tensor {
        storage: Vec<Value>,
        offset: i64,
        shape: Vec<i64>,
        stride: Vec<i64>,
    },
    Mark,
}

impl Value {
    pub(super) fn int(&self) -> Option<i64> {
        match self {
            Self::Int(value) => Some(*value),
            _ => None,
        }
    }

    pub(super) fn text(&self) -> Option<&str> {
        match self {
            Self::Text(text) => Some(text),
            _ => None,
        }
    }

    pub(super) fn sequence(&self) -> Option<&[Value]> {
        match self {
            Self::Sequence(values) => Some(values),
            _ => None,
        }
    }

    fn ints(&self) -> Option<Vec<i64>> {
        self.sequence()?.iter().map(Self::int).collect()
    }
}

/// The machine that reads one pickle after another from the same bytes.
pub(super) struct Reader<'a> {
    bytes: &'a [u8],
    at: usize,
}

/// Stack of one pickle.
#[derive(Default)]
struct Machine {
    stack: Vec<Value>,
    memo: HashMap<u32, Value>,
}

impl<'a> Reader<'a> {
    pub(super) fn new(bytes: &'a [u8]) -> Self {
        Self { bytes, at: 0 }
    }

    /// The next bytes, raw.
    pub(super) fn take(&mut self, count: usize) -> Result<&'a [u8], String> {
        let end = self
            .at
            .checked_add(count)
            .filter(|e| *e <= self.bytes.len());
        let end = end.ok_or("it ends too early")?;
        let out = &self.bytes[self.at..end];
        self.at = end;
        Ok(out)
    }

    fn number<const N: usize>(&mut self) -> Result<[u8; N], String> {
        self.take(N)?
            .try_into()
            .map_err(|_| "it ends too early".to_owned())
    }

    fn length(&mut self) -> Result<usize, String> {
        Ok(u32::from_le_bytes(self.number()?) as usize)
    }

    fn line(&mut self) -> Result<String, String> {
        let rest = &self.bytes[self.at..];
        let end = rest.iter().position(|b| *b == b'\n');
        let line = self.take(end.ok_or("it ends too early")?)?;
        self.at += 1;
        Ok(String::from_utf8_lossy(line).into_owned())
    }

    fn text(&mut self, length: usize) -> Result<Value, String> {
        let bytes = self.take(length)?;
        Ok(Value::Text(String::from_utf8_lossy(bytes).into_owned()))
    }

    /// Reads one pickle.
    pub(super) fn value(&mut self) -> Result<Value, String> {
        let mut m = Machine::default();
        loop {
            let code = self.take(1)?[0];
            match code {
                0x80 => drop(self.take(1)?),
                0x95 => drop(self.take(8)?),
                b'.' => return m.pop(),
                b'(' => m.stack.push(Value::Mark),
                b'0' => drop(m.pop()?),
                b'N' => m.stack.push(Value::Opaque),
                0x88 => m.stack.push(Value::Bool(true)),
                0x89 => m.stack.push(Value::Bool(false)),
                b'K' => {
                    let [v] = self.number()?;
                    m.stack.push(Value::Int(i64::from(v)));
                }
                b'M' => {
                    let v = u16::from_le_bytes(self.number()?);
                    m.stack.push(Value::Int(i64::from(v)));
                }
                b'J' => {
                    let v = i32::from_le_bytes(self.number()?);
                    m.stack.push(Value::Int(i64::from(v)));
                }
                0x8a => {
                    let [length] = self.number()?;
                    let bytes = self.take(usize::from(length))?;
                    m.stack.push(long(bytes));
                }
                b'G' => {
                    self.take(8)?;
                    m.stack.push(Value::Opaque);
                }
                b'X' | b'T' => {
                    let length = self.length()?;
                    m.stack.push(self.text(length)?);
                }
                0x8c | b'U' => {
                    let [length] = self.number()?;
                    m.stack.push(self.text(usize::from(length))?);
                }
                b'c' => {
                    let global = format!("{} {}", self.line()?, self.line()?);
                    m.stack.push(Value::Global(global));
                }
                0x93 => {
                    let (name, module) = (m.pop()?, m.pop()?);
                    let of = |v: &Value| v.text().unwrap_or_default().to_owned();
                    m.stack
                        .push(Value::Global(format!("{} {}", of(&module), of(&name))));
                }
                b'q' => {
                    let [key] = self.number()?;
                    m.remember(u32::from(key))?;
                }
                b'r' => {
                    let key = u32::from_le_bytes(self.number()?);
                    m.remember(key)?;
                }
                0x94 => {
                    let key = m.memo.len() as u32;
                    m.remember(key)?;
                }
                b'h' => {
                    let [key] = self.number()?;
                    m.recall(u32::from(key))?;
                }
                b'j' => {
                    let key = u32::from_le_bytes(self.number()?);
                    m.recall(key)?;
                }
                b')' | b']' => m.stack.push(Value::Sequence(Vec::new())),
                b'}' => m.stack.push(Value::Dict(Vec::new())),
                b't' => {
                    let values = m.after_mark()?;
                    m.stack.push(Value::Sequence(values));
                }
                0x85..=0x87 => {
                    let count = usize::from(code - 0x84);
                    let from = m
                        .stack
                        .len()
                        .checked_sub(count)
                        .ok_or("its stack is empty")?;
                    let values = m.stack.split_off(from);
                    m.stack.push(Value::Sequence(values));
                }
                b'a' => {
                    let value = m.pop()?;
                    m.extend(vec![value]);
                }
                b'e' => {
                    let values = m.after_mark()?;
                    m.extend(values);
                }
                b's' => {
                    let (value, key) = (m.pop()?, m.pop()?);
                    m.set(vec![key, value]);
                }
                b'u' => {
                    let values = m.after_mark()?;
                    m.set(values);
                }
                b'b' => drop(m.pop()?),
                b'Q' => {
                    let id = m.pop()?;
                    let id = id.sequence().map(<[Value]>::to_vec).unwrap_or_default();
                    m.stack.push(Value::Storage(id));
                }
                b'R' | 0x81 => {
                    let (arguments, function) = (m.pop()?, m.pop()?);
                    m.stack.push(call(&function, &arguments));
                }
                other => return Err(format!("it uses the unknown pickle code {other:#04x}")),
            }
        }
    }
}

impl Machine {
    fn pop(&mut self) -> Result<Value, String> {
        self.stack.pop().ok_or("its stack is empty".to_owned())
    }

    fn after_mark(&mut self) -> Result<Vec<Value>, String> {
        let mark = self.stack.iter().rposition(|v| *v == Value::Mark);
        let values = self.stack.split_off(mark.ok_or("it has no mark")?);
        Ok(values.into_iter().skip(1).collect())
    }

    fn remember(&mut self, key: u32) -> Result<(), String> {
        let top = self.stack.last().ok_or("its stack is empty")?;
        self.memo.insert(key, top.clone());
        Ok(())
    }

    fn recall(&mut self, key: u32) -> Result<(), String> {
        let value = self
            .memo
            .get(&key)
            .ok_or("it recalls what it never named")?;
        self.stack.push(value.clone());
        Ok(())
    }

    fn extend(&mut self, values: Vec<Value>) {
        if let Some(Value::Sequence(list)) = self.stack.last_mut() {
            list.extend(values);
        }
    }

    fn set(&mut self, values: Vec<Value>) {
        if let Some(Value::Dict(dict)) = self.stack.last_mut() {
            let mut values = values.into_iter();
            while let (Some(key), Some(value)) = (values.next(), values.next()) {
                dict.push((key, value));
            }
        }
    }
}

/// A little-endian integer of any length; one that does not fit is opaque (PyTorch's magic number is).
fn long(bytes: &[u8]) -> Value {
    if bytes.len() > 8 {
        return Value::Opaque;
    }
    let negative = bytes.last().is_some_and(|b| b & 0x80 != 0);
    let mut all = [if negative { 0xff } else { 0 }; 8];
    all[..bytes.len()].copy_from_slice(bytes);
    Value::Int(i64::from_le_bytes(all))
}

/// What a call makes.
fn call(function: &Value, arguments: &Value) -> Value {
    let Value::Global(name) = function else {
        return Value::Opaque;
    };
    let arguments = arguments.sequence().unwrap_or_default();
    match name.as_str() {
        "collections OrderedDict" => Value::Dict(Vec::new()),
        "torch._utils _rebuild_parameter" => arguments.first().cloned().unwrap_or(Value::Opaque),
        "torch._utils _rebuild_tensor" | "torch._utils _rebuild_tensor_v2" => {
            match (
                arguments.first(),
                arguments.get(1).and_then(Value::int),
                arguments.get(2).and_then(Value::ints),
                arguments.get(3).and_then(Value::ints),
            ) {
                (Some(Value::Storage(id)), Some(offset), Some(shape), Some(stride)) => {
                    Value::Tensor {
                        storage: id.clone(),
                        offset,
                        shape,
                        stride,
                    }
                }
                _ => Value::Opaque,
            }
        }
        _ => Value::Opaque,
    }
}
