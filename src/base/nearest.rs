//! The name that was probably meant.

/// The one of `known` fewest edits away from `name`, in upper or lower case, if these are few for its length.
pub fn nearest<'a>(name: &str, known: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let name = name.to_ascii_lowercase();
    let edits = |known: &str| strsim::levenshtein(&name, &known.to_ascii_lowercase());
    known
        .into_iter()
        .map(|known| (edits(known), known))
        .filter(|&(edits, known)| edits <= known.len() / 3)
        .min_by_key(|&(edits, _)| edits)
        .map(|(_, known)| known)
}

/// The same as words for an error: ` (did you mean ..?)`, or nothing.
pub fn did_you_mean<'a>(name: &str, known: impl IntoIterator<Item = &'a str>) -> String {
    nearest(name, known).map_or(String::new(), |known| format!(" (did you mean `{known}`?)"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn few_edits_are_a_slip_and_many_another_name() {
        let known = ["level", "matrix", "gilbert"];
        assert_eq!(nearest("Gilbrt", known), Some("gilbert"));
        assert_eq!(nearest("levle", known), None, "two of five");
        assert_eq!(nearest("zzz", known), None);
        assert_eq!(did_you_mean("matrx", known), " (did you mean `matrix`?)");
    }
}
