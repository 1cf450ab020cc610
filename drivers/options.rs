//! What a rig file says to one driver alone, under `options`.

use std::collections::BTreeMap;

use beampose_core::InstrumentError;

/// One option that a driver takes.
#[derive(Debug, Clone, Copy)]
pub struct OptionSpec {
    /// Its key.
    pub name: &'static str,
    /// What it is, with its unit.
    pub about: &'static str,
    /// Taken where the rig file says nothing; without it the option must be there.
    pub default: Option<Value>,
    /// Which kind of value: an example of it.
    pub example: Value,
}

/// The value of an option.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Value {
    /// A number.
    Number(f64),
    /// A text.
    Text(&'static str),
    /// Yes or no.
    Switch(bool),
}

impl Value {
    fn word(self) -> &'static str {
        match self {
            Self::Number(_) => "a number",
            Self::Text(_) => "a text",
            Self::Switch(_) => "true or false",
        }
    }

    fn text(self) -> String {
        match self {
            Self::Number(x) => x.to_string(),
            Self::Text(x) => x.to_owned(),
            Self::Switch(x) => x.to_string(),
        }
    }
}

/// The options of one instrument: every one that its driver has, checked.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Options(BTreeMap<&'static str, String>);

impl Options {
    /// The options as written, with the defaults of those that are not.
    ///
    /// # Errors
    /// The key at fault and what is wrong with it: unknown (with the nearest that is known), not of
    /// its kind, missing.
    pub fn read(
        specs: &'static [OptionSpec],
        written: &BTreeMap<String, String>,
    ) -> Result<Self, (String, String)> {
        if let Some(key) = written.keys().find(|key| specs.iter().all(|spec| spec.name != **key)) {
            let near = specs.iter().map(|spec| spec.name).max_by(|a, b| {
                strsim::jaro_winkler(a, key).total_cmp(&strsim::jaro_winkler(b, key))
            });
            let why = match near {
                Some(near) => format!("unknown option {key:?}; did you mean {near:?}?"),
                None => format!("unknown option {key:?}: this driver takes none"),
            };
            return Err((key.clone(), why));
        }
        let mut values = BTreeMap::new();
        for spec in specs {
            let text = match (written.get(spec.name), spec.default) {
                (Some(text), _) => text.clone(),
                (None, Some(default)) => default.text(),
                (None, None) => {
                    let why = format!("option {:?} is missing: {}", spec.name, spec.about);
                    return Err((spec.name.to_owned(), why));
                }
            };
            let fits = match spec.example {
                Value::Number(_) => text.parse::<f64>().is_ok_and(f64::is_finite),
                Value::Switch(_) => text.parse::<bool>().is_ok(),
                Value::Text(_) => true,
            };
            if !fits {
                let (word, name) = (spec.example.word(), spec.name);
                return Err((name.to_owned(), format!("{name}: expected {word}, found {text:?}")));
            }
            values.insert(spec.name, text);
        }
        Ok(Self(values))
    }

    /// An option that is a text.
    ///
    /// # Errors
    /// [`InstrumentError::Refused`] where the driver has no such option: a mistake in the driver.
    pub fn text(&self, name: &str) -> Result<&str, InstrumentError> {
        let missing = || InstrumentError::Refused(format!("there is no option {name:?}"));
        self.0.get(name).map(String::as_str).ok_or_else(missing)
    }

    /// An option that is a number.
    ///
    /// # Errors
    /// As [`Options::text`].
    pub fn number(&self, name: &str) -> Result<f64, InstrumentError> {
        let text = self.text(name)?;
        let wrong = |_| InstrumentError::Refused(format!("option {name} is no number: {text:?}"));
        text.parse().map_err(wrong)
    }

    /// An option that is a number above zero.
    ///
    /// # Errors
    /// [`InstrumentError::Refused`] where it is not.
    pub fn positive(&self, name: &str) -> Result<f64, InstrumentError> {
        let number = self.number(name)?;
        if number > 0.0 {
            return Ok(number);
        }
        let why = format!("option {name} must be above zero, found {number}");
        Err(InstrumentError::Refused(why))
    }

    /// An option that is a whole number from `low` to `high`.
    ///
    /// # Errors
    /// [`InstrumentError::Refused`] with both bounds.
    pub fn whole(&self, name: &str, low: u32, high: u32) -> Result<u32, InstrumentError> {
        let text = self.text(name)?;
        match text.parse::<u32>() {
            Ok(whole) if (low..=high).contains(&whole) => Ok(whole),
            _ => {
                let why = format!("option {name} must be {low} to {high}, found {text}");
                Err(InstrumentError::Refused(why))
            }
        }
    }

    /// An option that is yes or no.
    ///
    /// # Errors
    /// As [`Options::text`].
    pub fn switch(&self, name: &str) -> Result<bool, InstrumentError> {
        Ok(self.text(name)? == "true")
    }
}
