//! The outermost layers of an ONNX file, looked at before the library reads it.
//!
//! rten 0.24 trusts the lengths of the outermost message: one that is negative as a signed number sends it back to where it
//! was, for ever. It also follows graphs within graphs as deep as they go.

/// Says what is wrong with the content of a file.
pub(super) fn check(bytes: &[u8]) -> Result<(), &'static str> {
    const NO_ONNX: &str = "it is no ONNX file, or damaged";
    let [graph_in_model, node_in_graph, attribute, subgraph, subgraphs] = [7, 1, 5, 6, 11];
    let within = |bytes, number| {
        fields(bytes).map(move |fields| fields.into_iter().filter(move |(it, _)| *it == number))
    };
    for (_, graph) in within(bytes, graph_in_model).ok_or(NO_ONNX)? {
        for (_, node) in within(graph, node_in_graph).ok_or(NO_ONNX)? {
            for (_, about) in within(node, attribute).ok_or(NO_ONNX)? {
                let inner = fields(about).ok_or(NO_ONNX)?;
                if inner.iter().any(|(number, _)| [subgraph, subgraphs].contains(number)) {
                    return Err(
                        "it has graphs within its graph, as loops and conditions do, which policies here cannot have",
                    );
                }
            }
        }
    }
    Ok(())
}

/// The numbers of the fields of a message, and their bytes if they are counted; `None` if it ends within one.
fn fields(mut bytes: &[u8]) -> Option<Vec<(u64, &[u8])>> {
    let mut found = Vec::new();
    while !bytes.is_empty() {
        let key = varint(&mut bytes)?;
        let length = match key & 7 {
            0 => varint(&mut bytes).map(|_| 0)?,
            1 => 8,
            2 => usize::try_from(varint(&mut bytes)?).ok()?,
            5 => 4,
            _ => return None,
        };
        found.push((key >> 3, bytes.split_off(..length)?));
    }
    Some(found)
}

fn varint(bytes: &mut &[u8]) -> Option<u64> {
    let mut value = 0;
    for shift in (0..64).step_by(7) {
        let byte = *bytes.split_off_first()?;
        value |= u64::from(byte & 0x7f) << shift;
        if byte & 0x80 == 0 {
            return Some(value);
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    fn part(number: u8, bytes: &[u8]) -> Vec<u8> {
        [&[number << 3 | 2, bytes.len() as u8][..], bytes].concat()
    }

    #[test]
    fn lengths_stay_within_bounds_and_graphs_are_not_nested() {
        let node = part(5, &part(1, b"axis"));
        let file = [&[8, 8][..], &part(7, &part(1, &node))].concat();
        assert_eq!(check(&file), Ok(()));
        for end in 3..file.len() {
            assert!(check(&file[..end]).is_err(), "{end}");
        }
        let back = [&[0x1a][..], &[0xff; 9], &[1]].concat();
        assert!(check(&back).is_err());
        let nested = part(7, &part(1, &part(5, &part(6, &[]))));
        assert!(check(&nested).unwrap_err().contains("within"));
    }
}
