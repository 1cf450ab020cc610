//! "Did you mean": the nearest valid name.

/// The help for a name that is not among `known`: the nearest, or else all of them.
pub(crate) fn help<'a>(found: &str, known: impl IntoIterator<Item = &'a str>) -> Option<String> {
    let known: Vec<&str> = known.into_iter().collect();
    if let Some(near) = nearest(found, &known) {
        return Some(format!("did you mean `{near}`?"));
    }
    let list = quoted(&known);
    (!known.is_empty()).then(|| format!("valid here: {list}"))
}

/// `a`, `b`, `c`.
pub(crate) fn quoted(names: &[&str]) -> String {
    names.iter().map(|name| format!("`{name}`")).collect::<Vec<_>>().join(", ")
}

/// The nearest name, if one is near.
pub(crate) fn nearest<'a>(found: &str, known: &[&'a str]) -> Option<&'a str> {
    let found = found.to_lowercase().replace(['-', ' '], "_");
    // A third of the letters may be wrong; more than that is another word.
    let tolerance = (found.chars().count() / 3).max(1);
    known
        .iter()
        .map(|name| (strsim::damerau_levenshtein(&found, &name.replace('-', "_")), *name))
        .filter(|(distance, _)| *distance <= tolerance)
        .min_by_key(|(distance, _)| *distance)
        .map(|(_, name)| name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_slip_of_the_finger_finds_its_name_and_another_word_does_not() {
        assert_eq!(help("lazer", ["wait", "laser"]).unwrap(), "did you mean `laser`?");
        assert_eq!(
            help("virtual_camera", ["virtual-camera"]).unwrap(),
            "did you mean `virtual-camera`?"
        );
        assert_eq!(help("banana", ["wait", "laser"]).unwrap(), "valid here: `wait`, `laser`");
    }
}
