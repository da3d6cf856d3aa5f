//! How documents are laid out: one key a line, but lists of numbers and names on one line, so
//! that a person finds a way through them.

use std::io::{Result, Write};

use serde_json::ser::Formatter;

/// Indents by two blanks, except inside lists of plain values.
#[derive(Debug, Default)]
pub(super) struct Layout {
    /// For every open list or object: whether its end goes on a line of its own.
    broken: Vec<bool>,
    /// Whether what comes next is an element of a list.
    element: bool,
}

impl Layout {
    /// Opens a list or an object; inside a list it starts on a line of its own.
    fn open<W: Write + ?Sized>(&mut self, writer: &mut W, bracket: &[u8]) -> Result<()> {
        if std::mem::take(&mut self.element) {
            self.break_line(writer)?;
        }
        self.broken.push(false);
        writer.write_all(bracket)
    }

    fn close<W: Write + ?Sized>(&mut self, writer: &mut W, bracket: &[u8]) -> Result<()> {
        if self.broken.pop() == Some(true) {
            new_line(writer, self.broken.len())?;
        }
        writer.write_all(bracket)
    }

    fn break_line<W: Write + ?Sized>(&mut self, writer: &mut W) -> Result<()> {
        if let Some(broken) = self.broken.last_mut() {
            *broken = true;
        }
        new_line(writer, self.broken.len())
    }
}

fn new_line<W: Write + ?Sized>(writer: &mut W, depth: usize) -> Result<()> {
    writer.write_all(b"\n")?;
    (0..depth).try_for_each(|_| writer.write_all(b"  "))
}

impl Formatter for Layout {
    fn begin_array<W: Write + ?Sized>(&mut self, writer: &mut W) -> Result<()> {
        self.open(writer, b"[")
    }

    fn end_array<W: Write + ?Sized>(&mut self, writer: &mut W) -> Result<()> {
        self.close(writer, b"]")
    }

    fn begin_array_value<W: Write + ?Sized>(&mut self, writer: &mut W, first: bool) -> Result<()> {
        self.element = true;
        if first {
            Ok(())
        } else {
            writer.write_all(b",")
        }
    }

    fn end_array_value<W: Write + ?Sized>(&mut self, _: &mut W) -> Result<()> {
        self.element = false;
        Ok(())
    }

    fn begin_object<W: Write + ?Sized>(&mut self, writer: &mut W) -> Result<()> {
        self.open(writer, b"{")
    }

    fn end_object<W: Write + ?Sized>(&mut self, writer: &mut W) -> Result<()> {
        self.close(writer, b"}")
    }

    fn begin_object_key<W: Write + ?Sized>(&mut self, writer: &mut W, first: bool) -> Result<()> {
        if !first {
            writer.write_all(b",")?;
        }
        self.break_line(writer)
    }

    fn begin_object_value<W: Write + ?Sized>(&mut self, writer: &mut W) -> Result<()> {
        writer.write_all(b": ")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde::Serialize;
    use serde_json::{Serializer, Value, json};

    fn laid_out(value: &Value) -> String {
        let mut bytes = Vec::new();
        let mut serializer = Serializer::with_formatter(&mut bytes, Layout::default());
        value.serialize(&mut serializer).unwrap();
        String::from_utf8(bytes).unwrap()
    }

    #[test]
    fn lists_of_plain_values_stay_on_one_line() {
        let value = json!({
            "a": [1.5, null, "x"],
            "b": [{"c": 1, "d": []}, {}, [[1], [2, 3]]],
            "e": {"f": true}
        });
        let text = laid_out(&value);
        assert_eq!(
            text,
            "{\n  \"a\": [1.5,null,\"x\"],\n  \"b\": [\n    {\n      \"c\": 1,\n      \"d\": []\n    \
             },\n    {},\n    [\n      [1],\n      [2,3]\n    ]\n  ],\n  \"e\": {\n    \"f\": \
             true\n  }\n}"
        );
        assert_eq!(serde_json::from_str::<Value>(&text).unwrap(), value);
    }
}
