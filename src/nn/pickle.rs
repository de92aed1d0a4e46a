//! Pickles, as far as PyTorch's `torch.save` writes them for state dicts: which tensors there are, by name, and where
//! their values lie. Nothing that a pickle names is run.
//!
//! An opcode makes one object at most, objects name others by number, and nothing here recurses, so what reading takes
//! is bounded by the length of the pickle, however its objects refer to each other.

use std::collections::HashMap;

/// A tensor as a pickle describes it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct PickledTensor {
    /// The kind of its values, such as `FloatStorage`.
    pub(super) storage: String,
    /// The name of the file with its values.
    pub(super) file: String,
    /// Where its first value is in there, in values.
    pub(super) offset: usize,
    /// How many entries it has along each axis.
    pub(super) shape: Vec<usize>,
    /// How many values further the next entry along each axis is.
    pub(super) strides: Vec<usize>,
}

/// The tensors of the dict that a pickle holds. Other entries are passed over.
pub(super) fn tensors(pickle: &[u8]) -> Result<Vec<(String, PickledTensor)>, String> {
    let mut machine = Machine { rest: pickle, ..Machine::default() };
    let root = machine.run()?;
    let Object::Dict(entries) = &machine.objects[root] else {
        return Err("it holds no dict".to_owned());
    };
    let mut tensors = Vec::new();
    for (key, value) in entries {
        if let (Object::Text(name), Some(tensor)) = (&machine.objects[*key], machine.tensor(*value)?) {
            tensors.push((name.clone(), tensor));
        }
    }
    Ok(tensors)
}

/// Where an object is in the list of all.
type Number = usize;

#[derive(Debug)]
enum Object {
    /// Nothing that matters here: `None`, floats, lists.
    Other,
    Whole(i64),
    Text(String),
    /// Module and name of something in Python.
    Global(String),
    Tuple(Vec<Number>),
    Dict(Vec<(Number, Number)>),
    /// What a function makes of arguments.
    Call(Number, Number),
    /// What lies outside of the pickle, by its identity.
    Outside(Number),
}

/// What carries out the opcodes.
#[derive(Debug, Default)]
struct Machine<'a> {
    rest: &'a [u8],
    objects: Vec<Object>,
    stack: Vec<Number>,
    /// How long the stack was at each mark.
    marks: Vec<usize>,
    memo: HashMap<u32, Number>,
}

impl Machine<'_> {
    /// The object that is left.
    fn run(&mut self) -> Result<Number, String> {
        loop {
            let [opcode] = self.take::<1>()?;
            match opcode {
                b'.' => return self.pop(),
                // The version of the protocol.
                0x80 => drop(self.take::<1>()?),
                b'(' => self.marks.push(self.stack.len()),
                b'}' => self.push(Object::Dict(Vec::new())),
                b')' => self.push(Object::Tuple(Vec::new())),
                b']' | b'N' => self.push(Object::Other),
                b'G' => {
                    self.take::<8>()?;
                    self.push(Object::Other);
                }
                0x88 => self.push(Object::Whole(1)),
                0x89 => self.push(Object::Whole(0)),
                b'J' => {
                    let value = i32::from_le_bytes(self.take()?);
                    self.push(Object::Whole(value.into()));
                }
                b'K' => {
                    let [value] = self.take()?;
                    self.push(Object::Whole(value.into()));
                }
                b'M' => {
                    let value = u16::from_le_bytes(self.take()?);
                    self.push(Object::Whole(value.into()));
                }
                0x8a => self.push_long()?,
                b'X' => {
                    let length = u32::from_le_bytes(self.take()?);
                    let text = self.bytes(length as usize)?;
                    let text = std::str::from_utf8(text).map_err(|_| "its text is no text")?.to_owned();
                    self.push(Object::Text(text));
                }
                b'c' => {
                    let global = format!("{} {}", self.line()?, self.line()?);
                    self.push(Object::Global(global));
                }
                b'q' => {
                    let [place] = self.take()?;
                    self.remember(place.into())?;
                }
                b'r' => {
                    let place = u32::from_le_bytes(self.take()?);
                    self.remember(place)?;
                }
                b'h' => {
                    let [place] = self.take()?;
                    self.recall(place.into())?;
                }
                b'j' => {
                    let place = u32::from_le_bytes(self.take()?);
                    self.recall(place)?;
                }
                0x85..=0x87 => self.push_tuple_of(usize::from(opcode - 0x84))?,
                b't' => {
                    let parts = self.pop_to_mark()?;
                    self.push(Object::Tuple(parts));
                }
                b's' => {
                    let (value, key) = (self.pop()?, self.pop()?);
                    self.set(&[key, value])?;
                }
                b'u' => {
                    let entries = self.pop_to_mark()?;
                    self.set(&entries)?;
                }
                b'a' => drop(self.pop()?),
                b'e' => drop(self.pop_to_mark()?),
                b'Q' => {
                    let identity = self.pop()?;
                    self.push(Object::Outside(identity));
                }
                b'R' => self.call()?,
                // What an object is told after it was made, such as the versions of its layers.
                b'b' => drop(self.pop()?),
                other => return Err(format!("opcode {other:#04x} is none of a state dict")),
            }
        }
    }

    /// The tensor that an object is, if it is one.
    fn tensor(&self, number: Number) -> Result<Option<PickledTensor>, String> {
        let plain = match self.called(number) {
            // A tensor that is trained: the first argument of what makes it.
            Some(("torch._utils _rebuild_parameter", &[tensor, ..])) => self.called(tensor),
            called => called,
        };
        match plain {
            Some(("torch._utils _rebuild_tensor_v2", arguments)) => {
                self.rebuilt(arguments).map(Some).ok_or_else(|| "a tensor of it makes no sense".to_owned())
            }
            _ => Ok(None),
        }
    }

    /// The function and the arguments of a call.
    fn called(&self, number: Number) -> Option<(&str, &[Number])> {
        let Object::Call(function, arguments) = self.objects[number] else { return None };
        match &self.objects[function] {
            Object::Global(name) => Some((name, self.tuple(arguments)?)),
            _ => None,
        }
    }

    fn rebuilt(&self, arguments: &[Number]) -> Option<PickledTensor> {
        let &[outside, offset, shape, strides, ..] = arguments else { return None };
        let Object::Outside(identity) = self.objects[outside] else { return None };
        let &[_, storage, file, ..] = self.tuple(identity)? else { return None };
        let (Object::Global(storage), Object::Text(file)) = (&self.objects[storage], &self.objects[file])
        else {
            return None;
        };
        let sizes = |tuple| -> Option<Vec<usize>> {
            self.tuple(tuple)?.iter().map(|&number| self.size(number)).collect()
        };
        let (shape, strides) = (sizes(shape)?, sizes(strides)?);
        (shape.len() == strides.len()).then_some(())?;
        let storage = storage.strip_prefix("torch ").unwrap_or(storage).to_owned();
        Some(PickledTensor { storage, file: file.clone(), offset: self.size(offset)?, shape, strides })
    }

    fn tuple(&self, number: Number) -> Option<&[Number]> {
        match &self.objects[number] {
            Object::Tuple(parts) => Some(parts),
            _ => None,
        }
    }

    fn size(&self, number: Number) -> Option<usize> {
        match self.objects[number] {
            Object::Whole(value) => value.try_into().ok(),
            _ => None,
        }
    }

    fn call(&mut self) -> Result<(), String> {
        let (arguments, function) = (self.pop()?, self.pop()?);
        let is_dict =
            matches!(&self.objects[function], Object::Global(name) if name == "collections OrderedDict");
        self.push(if is_dict { Object::Dict(Vec::new()) } else { Object::Call(function, arguments) });
        Ok(())
    }

    /// Keys and values by turns.
    fn set(&mut self, entries: &[Number]) -> Result<(), String> {
        let dict = *self.stack.last().ok_or("it takes from an empty stack")?;
        let (entries, []) = entries.as_chunks::<2>() else {
            return Err("a key of it has no value".to_owned());
        };
        if let Object::Dict(all) = &mut self.objects[dict] {
            all.extend(entries.iter().map(|[key, value]| (*key, *value)));
        }
        Ok(())
    }

    fn push_tuple_of(&mut self, length: usize) -> Result<(), String> {
        let floor = self.marks.last().copied().unwrap_or(0);
        let from = self.stack.len().checked_sub(length).filter(|from| *from >= floor);
        let parts = self.stack.split_off(from.ok_or("it takes from an empty stack")?);
        self.push(Object::Tuple(parts));
        Ok(())
    }

    /// A whole number of any length, of which only those of 64 bits matter.
    fn push_long(&mut self) -> Result<(), String> {
        let [length] = self.take()?;
        let bytes = self.bytes(length.into())?;
        let sign = if bytes.last().is_some_and(|byte| byte & 0x80 != 0) { 0xff } else { 0 };
        let mut value = [sign; 8];
        let object = match value.get_mut(..bytes.len()) {
            Some(low) => {
                low.copy_from_slice(bytes);
                Object::Whole(i64::from_le_bytes(value))
            }
            None => Object::Other,
        };
        self.push(object);
        Ok(())
    }

    fn push(&mut self, object: Object) {
        self.stack.push(self.objects.len());
        self.objects.push(object);
    }

    fn pop(&mut self) -> Result<Number, String> {
        let floor = self.marks.last().copied().unwrap_or(0);
        let top = (self.stack.len() > floor).then(|| self.stack.pop()).flatten();
        top.ok_or_else(|| "it takes from an empty stack".to_owned())
    }

    fn pop_to_mark(&mut self) -> Result<Vec<Number>, String> {
        let mark = self.marks.pop().ok_or("it has no mark")?;
        Ok(self.stack.split_off(mark))
    }

    fn remember(&mut self, place: u32) -> Result<(), String> {
        let top = *self.stack.last().ok_or("it takes from an empty stack")?;
        self.memo.insert(place, top);
        Ok(())
    }

    fn recall(&mut self, place: u32) -> Result<(), String> {
        self.stack.push(*self.memo.get(&place).ok_or("it recalls what it does not remember")?);
        Ok(())
    }

    fn take<const N: usize>(&mut self) -> Result<[u8; N], String> {
        let (taken, rest) = self.rest.split_first_chunk().ok_or("it ends too early")?;
        self.rest = rest;
        Ok(*taken)
    }

    fn bytes(&mut self, length: usize) -> Result<&[u8], String> {
        let (taken, rest) = self.rest.split_at_checked(length).ok_or("it ends too early")?;
        self.rest = rest;
        Ok(taken)
    }

    fn line(&mut self) -> Result<String, String> {
        let end = self.rest.iter().position(|byte| *byte == b'\n').ok_or("it ends too early")?;
        let line = std::str::from_utf8(&self.rest[..end]).map_err(|_| "its text is no text")?.to_owned();
        self.rest = &self.rest[end + 1..];
        Ok(line)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn objects_that_double_take_no_more_than_their_opcodes() {
        // A tuple of itself twice, a hundred times: 2^100 of the first when taken apart.
        let mut bomb = b"\x80\x02)q\x00".to_vec();
        (0..100).for_each(|_| bomb.extend(b"h\x00h\x00\x86q\x00"));
        bomb.push(b'.');
        assert_eq!(tensors(&bomb), Err("it holds no dict".to_owned()));
    }

    #[test]
    fn numbers_of_all_lengths() {
        let mut machine = Machine::default();
        for (pickle, value) in [
            (&b"K\xff."[..], 255),
            (b"M\xff\xff.", 65535),
            (b"J\xff\xff\xff\xff.", -1),
            (b"\x8a\x00.", 0),
            (b"\x8a\x01\xff.", -1),
            (b"\x8a\x05\x00\x00\x00\x00\x01.", 1 << 32),
        ] {
            machine.rest = pickle;
            let number = machine.run().unwrap();
            assert!(matches!(machine.objects[number], Object::Whole(found) if found == value), "{pickle:?}");
        }
    }

    #[test]
    fn a_pickle_that_breaks_off_or_takes_too_much_is_refused() {
        for pickle in [
            &b""[..],
            b".",
            b"(.",
            b"}",
            b"}K",
            b"}X\xff\xff\xff\xffa.",
            b"(u.",
            b"}(K\x01u.",
            b"h\x00.",
            b"\xff",
        ] {
            assert!(tensors(pickle).is_err(), "{pickle:?}");
        }
        assert_eq!(tensors(b"}X\x01\x00\x00\x00aK\x01s."), Ok(Vec::new()));
    }
}
