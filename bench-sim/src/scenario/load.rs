//! From a name or a path and a list of overrides to a checked scenario.

use toml::{Table, Value};

use super::Scenario;
use super::limits::Checker;

/// The scenarios that come with the bench: name and text.
const BUILT_IN: [(&str, &str); 21] = [
    ("obstacle-avoidance", include_str!("../../scenarios/obstacle-avoidance.toml")),
    (
        "obstacle-avoidance-12m-back",
        include_str!("../../scenarios/obstacle-avoidance-12m-back.toml"),
    ),
    ("hil-obstacle-avoidance", include_str!("../../scenarios/hil-obstacle-avoidance.toml")),
    (
        "hil-obstacle-avoidance-delay",
        include_str!("../../scenarios/hil-obstacle-avoidance-delay.toml"),
    ),
    ("merging", include_str!("../../scenarios/merging.toml")),
    ("platooning", include_str!("../../scenarios/platooning.toml")),
    ("platooning-o", include_str!("../../scenarios/platooning-o.toml")),
    ("platooning-z", include_str!("../../scenarios/platooning-z.toml")),
    ("braking-obstacle", include_str!("../../scenarios/braking-obstacle.toml")),
    ("cut-in", include_str!("../../scenarios/cut-in.toml")),
    ("bump", include_str!("../../scenarios/bump.toml")),
    ("leader-sine", include_str!("../../scenarios/leader-sine.toml")),
    ("leader-emergency-braking", include_str!("../../scenarios/leader-emergency-braking.toml")),
    ("stop-and-go", include_str!("../../scenarios/stop-and-go.toml")),
    ("join", include_str!("../../scenarios/join.toml")),
    ("leave", include_str!("../../scenarios/leave.toml")),
    ("split", include_str!("../../scenarios/split.toml")),
    ("platoon-8", include_str!("../../scenarios/platoon-8.toml")),
    ("platoon-16", include_str!("../../scenarios/platoon-16.toml")),
    ("heterogeneous", include_str!("../../scenarios/heterogeneous.toml")),
    ("v2v-loss", include_str!("../../scenarios/v2v-loss.toml")),
];

/// Longest scenario file that is read \[bytes\].
const FILE_SIZE_MAX: u64 = 1 << 20;

/// One line of the list of scenarios.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Summary {
    /// What to call it on the command line.
    pub name: &'static str,
    /// What happens in it.
    pub description: String,
}

/// Why a scenario cannot be run. Every message is one line and says what to do.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ScenarioError {
    /// Neither a built-in scenario nor a file.
    #[error("no scenario {name:?}: use one of {known}, or the path of a TOML file")]
    Unknown {
        /// What was asked for.
        name: String,
        /// The built-in names.
        known: String,
    },
    /// The file is there but cannot be read.
    #[error("cannot read the scenario {file}: {reason}")]
    Unreadable {
        /// Its path.
        file: String,
        /// What the system said.
        reason: String,
    },
    /// The file is not TOML.
    #[error("{file} is not valid TOML: line {line}: {reason}")]
    Syntax {
        /// Its path.
        file: String,
        /// Where.
        line: usize,
        /// What the parser expected.
        reason: String,
    },
    /// A key is unknown, missing, or of the wrong type.
    #[error("{file}: {reason}")]
    Shape {
        /// Its path or name.
        file: String,
        /// What is wrong and what is allowed.
        reason: String,
    },
    /// An override names a key that cannot be, or gives it a value of the wrong type.
    #[error("--set {key}={value} does not fit {file}: {reason}")]
    Override {
        /// The scenario's path or name.
        file: String,
        /// The key.
        key: String,
        /// The value as given.
        value: String,
        /// What is wrong and what is allowed.
        reason: String,
    },
    /// A number that cannot be simulated.
    #[error("{file}: {key} = {value} is impossible: allowed is {allowed}")]
    Impossible {
        /// The scenario's path or name.
        file: String,
        /// The key, dotted; obstacles count from 1, trucks from 0.
        key: String,
        /// The value found.
        value: String,
        /// What is allowed.
        allowed: String,
    },
}

impl Scenario {
    /// Loads a scenario by built-in name or by path, and applies `(key, value)` overrides in order.
    ///
    /// A value is read as TOML (`18`, `0.15`, `true`, `[1, 2]`, `"text"`), and as a bare string if
    /// it is not TOML.
    ///
    /// # Errors
    /// One line naming the file, the key, the value and what is allowed.
    pub fn load(name_or_path: &str, sets: &[(String, String)]) -> Result<Self, ScenarioError> {
        Self::from_text(name_or_path, &read(name_or_path)?, sets)
    }

    /// The scenario a text describes, as [`load`](Self::load) makes it of a file; `file` is what
    /// errors call the text.
    ///
    /// # Errors
    /// As [`load`](Self::load).
    pub fn from_text(
        file: &str,
        text: &str,
        sets: &[(String, String)],
    ) -> Result<Self, ScenarioError> {
        let mut table: Table = text.parse().map_err(|error| syntax(file, text, &error))?;
        shaped(&table).map_err(|reason| ScenarioError::Shape { file: file.to_owned(), reason })?;
        let base = table.clone();
        for (key, value) in sets {
            put(&mut table, key, typed(value))
                .map_err(|reason| refused(file, (key, value), reason))?;
        }
        let scenario = shaped(&table).map_err(|reason| blame(file, &base, sets, reason))?;
        Checker::new(file).check(&scenario)?;
        Ok(scenario)
    }

    /// The built-in scenarios, with a line about each.
    pub fn list() -> Vec<Summary> {
        let summary = |&(name, text): &(&'static str, &str)| {
            let table: Table = text.parse().expect("a test parses every built-in scenario");
            let description = table.get("description").and_then(Value::as_str).unwrap_or_default();
            Summary { name, description: description.to_owned() }
        };
        BUILT_IN.iter().map(summary).collect()
    }

    /// The TOML text of a built-in scenario, comments included.
    pub fn built_in_text(name: &str) -> Option<&'static str> {
        BUILT_IN.iter().find(|(known, _)| *known == name).map(|(_, text)| *text)
    }
}

/// The text of a built-in scenario or of a file.
fn read(name_or_path: &str) -> Result<String, ScenarioError> {
    if let Some(text) = Scenario::built_in_text(name_or_path) {
        return Ok(text.to_owned());
    }
    let unreadable =
        |reason: String| ScenarioError::Unreadable { file: name_or_path.to_owned(), reason };
    match std::fs::metadata(name_or_path) {
        Ok(about) if about.is_dir() => Err(unreadable("it is a folder".to_owned())),
        Ok(about) if about.len() > FILE_SIZE_MAX => {
            Err(unreadable(format!("it is longer than {FILE_SIZE_MAX} bytes")))
        }
        Ok(_) => std::fs::read_to_string(name_or_path).map_err(|e| unreadable(e.to_string())),
        Err(_) => Err(ScenarioError::Unknown {
            name: name_or_path.to_owned(),
            known: BUILT_IN.map(|(name, _)| name).join(", "),
        }),
    }
}

fn syntax(file: &str, text: &str, error: &toml::de::Error) -> ScenarioError {
    let before = error.span().map_or(0, |span| span.start.min(text.len()));
    ScenarioError::Syntax {
        file: file.to_owned(),
        line: 1 + text.as_bytes()[..before].iter().filter(|&&byte| byte == b'\n').count(),
        reason: one_line(error.message()),
    }
}

/// The table as a scenario, or one line about what does not fit.
fn shaped(table: &Table) -> Result<Scenario, String> {
    let deserialised: Result<Scenario, toml::de::Error> = table.clone().try_into();
    deserialised.map_err(|error| {
        one_line(&error.to_string())
            .replace("expected usize", "expected a whole number")
            .replace("expected u32", "expected a whole number")
            .replace("expected f64", "expected a number")
    })
}

fn one_line(message: &str) -> String {
    let lines: Vec<&str> = message.lines().map(str::trim).filter(|line| !line.is_empty()).collect();
    lines.join(", ")
}

/// Which of the overrides does not fit: the first that does not even fit alone, else the last.
///
/// All are applied before any is judged, because some keys only make sense together.
fn blame(file: &str, base: &Table, sets: &[(String, String)], together: String) -> ScenarioError {
    for (key, value) in sets {
        let mut table = base.clone();
        let alone = put(&mut table, key, typed(value)).and_then(|()| shaped(&table));
        if let Err(reason) = alone {
            return refused(file, (key, value), reason);
        }
    }
    match sets.last() {
        Some((key, value)) => refused(file, (key, value), together),
        None => ScenarioError::Shape { file: file.to_owned(), reason: together },
    }
}

fn refused(file: &str, (key, value): (&str, &str), reason: String) -> ScenarioError {
    ScenarioError::Override {
        file: file.to_owned(),
        key: key.to_owned(),
        value: value.to_owned(),
        reason,
    }
}

/// A value from the command line: TOML if it is TOML, else a bare string.
fn typed(value: &str) -> Value {
    let parsed: Result<Table, _> = format!("value = {value}").parse();
    match parsed {
        Ok(mut table) if table.len() == 1 => {
            table.remove("value").unwrap_or_else(|| Value::String(value.to_owned()))
        }
        _ => Value::String(value.to_owned()),
    }
}

/// Puts a value at a dotted key. Numbers index arrays from 1; missing tables are made, so that a
/// section the file leaves out can still be set, and whatever is unknown is refused afterwards.
fn put(table: &mut Table, key: &str, value: Value) -> Result<(), String> {
    let mut parts = key.split('.');
    let last = parts.next_back().filter(|part| !part.is_empty()).ok_or("the key is empty")?;
    let mut place = table;
    let mut walked = String::new();
    while let Some(part) = parts.next() {
        walked = if walked.is_empty() { part.to_owned() } else { format!("{walked}.{part}") };
        let entry = place.entry(part).or_insert_with(|| Value::Table(Table::new()));
        place = match entry {
            Value::Table(inner) => inner,
            Value::Array(items) => element(items, parts.next(), &walked)?,
            _ => return Err(format!("{walked} is a value, it has no keys below it")),
        };
    }
    place.insert(last.to_owned(), value);
    Ok(())
}

/// The table at a position, counted from 1, of an array of tables.
fn element<'a>(
    items: &'a mut [Value],
    number: Option<&str>,
    array: &str,
) -> Result<&'a mut Table, String> {
    let count = items.len();
    number
        .and_then(|number| number.parse::<usize>().ok())
        .and_then(|number| items.get_mut(number.checked_sub(1)?))
        .and_then(Value::as_table_mut)
        .ok_or_else(|| format!("{array} are {array}.1 to {array}.{count}"))
}
