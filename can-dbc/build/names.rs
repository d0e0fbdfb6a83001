//! DBC names to Rust names.

/// `PositionX` to `position_x`.
pub(crate) fn snake_case(name: &str) -> String {
    let mut snake = String::new();
    let mut previous_is_lower = false;
    for letter in name.chars() {
        if letter.is_ascii_uppercase() && previous_is_lower {
            snake.push('_');
        }
        previous_is_lower = !letter.is_ascii_uppercase() && letter != '_';
        snake.push(letter.to_ascii_lowercase());
    }
    snake
}

/// `EgoState` to `EGO_STATE`.
pub(crate) fn constant_case(name: &str) -> String {
    snake_case(name).to_ascii_uppercase()
}

/// `TSC1` to `Tsc1`; `EgoState` stays as it is.
pub(crate) fn type_name(name: &str) -> String {
    if name.chars().any(|letter| letter.is_ascii_lowercase()) {
        return name.to_owned();
    }
    let (first, rest) = name.split_at(name.len().min(1));
    first.to_owned() + &rest.to_ascii_lowercase()
}

/// A value description to a variant: `held previous plan` to `HeldPreviousPlan`.
///
/// `None` when the description has no letter to start with or a character Rust cannot name.
pub(crate) fn variant(description: &str) -> Option<String> {
    let mut variant = String::new();
    for word in description.split([' ', '_', '-']) {
        let mut letters = word.chars();
        if let Some(first) = letters.next() {
            variant.push(first.to_ascii_uppercase());
            variant.extend(letters);
        }
    }
    let starts_well = variant.starts_with(|first: char| first.is_ascii_alphabetic());
    (starts_well && variant.chars().all(|c| c.is_ascii_alphanumeric())).then_some(variant)
}

/// Unit of the DBC to the suffix of the field; `None` for a unit the house has no suffix for.
pub(crate) fn unit_suffix(unit: &str) -> Option<&'static str> {
    Some(match unit {
        "" => "",
        "m" => "_m",
        "m/s" => "_mps",
        "m/s2" => "_mps2",
        "rad" => "_rad",
        "rad/s" => "_radps",
        "N" => "_n",
        "kg" => "_kg",
        "s" => "_s",
        "ns" => "_ns",
        "Hz" => "_hz",
        "%" => "_percent",
        "km/h" => "_kmph",
        "rpm" => "_rpm",
        _ => return None,
    })
}
