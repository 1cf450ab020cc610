//! How the simulated controller takes commands apart: abbreviations, remembered paths, other ways to
//! write numbers. The driver has none of these.

/// Every command, its short form in capitals as in the manual, and by which name [`super::sim`]
/// knows it.
const COMMANDS: &[(&str, &str)] = &[
    ("*IDN", "*IDN"),
    ("ERRors", "ERR"),
    ("RADix", "RAD"),
    ("HEXFLOAT", "HEXFLOAT"),
    ("TERM", "TERM"),
    ("TERMINAL", "TERMINAL"),
    ("ONDELAY", "ONDELAY"),
    ("LASer:COND", "LAS:COND"),
    ("LASer:LDI", "LAS:LDI"),
    ("LASer:I", "LAS:LDI"),
    ("LASer:SET:LDI", "LAS:SET:LDI"),
    ("LASer:SET:I", "LAS:SET:LDI"),
    ("LASer:LIMit:LDI", "LAS:LIM:LDI"),
    ("LASer:LIMit:I", "LAS:LIM:LDI"),
    ("LASer:OUTput", "LAS:OUT"),
    ("LASer:MODE", "LAS:MODE"),
    ("LASer:MODE:ILBW", "LAS:MODE:ILBW"),
    ("LASer:MODE:I", "LAS:MODE:ILBW"),
    ("LASer:MODE:IHBW", "LAS:MODE:IHBW"),
    ("LASer:MODE:ICW", "LAS:MODE:ICW"),
    ("LASer:MODE:MDI", "LAS:MODE:MDI"),
    ("LASer:ENABle:OUTOFF", "LAS:ENAB:OUTOFF"),
    ("TEC:COND", "TEC:COND"),
    ("TEC:T", "TEC:T"),
    ("TEC:SET:T", "TEC:SET:T"),
    ("TEC:OUTput", "TEC:OUT"),
];

/// A command that was found.
pub(super) struct Found {
    pub(super) word: &'static str,
    pub(super) is_query: bool,
}

/// One command of a line.
pub(super) struct Command<'a> {
    /// `None` where there is no such path.
    pub(super) found: Option<Found>,
    pub(super) value: &'a str,
}

/// Whether `text` is an abbreviation of a level such as `LASer`: at least its capitals, and a part
/// of the whole.
fn means(text: &str, level: &str) -> bool {
    let short = level.chars().take_while(|c| !c.is_ascii_lowercase()).count();
    let text = text.to_ascii_lowercase();
    text.len() >= short && level.to_ascii_lowercase().starts_with(&text)
}

/// Takes a command apart. `path` is where the command before it stood, and then where this one does.
pub(super) fn take_apart<'a>(command: &'a str, path: &mut Vec<String>) -> Command<'a> {
    let (header, value) = command.split_once(char::is_whitespace).unwrap_or((command, ""));
    let (header, is_query) = header.strip_suffix('?').map_or((header, false), |it| (it, true));
    if header.starts_with(':') {
        path.clear();
    }
    let levels: Vec<&str> = header.trim_start_matches(':').split(':').collect();
    let value = value.trim();
    for depth in (0..=path.len()).rev() {
        let whole: Vec<&str> =
            path[..depth].iter().map(String::as_str).chain(levels.iter().copied()).collect();
        let found = COMMANDS.iter().find(|(known, _)| {
            let known: Vec<&str> = known.split(':').collect();
            known.len() == whole.len() && whole.iter().zip(known).all(|(a, b)| means(a, b))
        });
        if let Some((_, word)) = found {
            let above: Vec<String> =
                whole[..whole.len() - 1].iter().map(|it| (*it).to_owned()).collect();
            *path = above;
            return Command { found: Some(Found { word, is_query }), value };
        }
    }
    Command { found: None, value }
}

/// A number as the instrument takes it: decimal, in another base, or a word for 0 and 1.
pub(super) fn number(text: &str) -> Option<f64> {
    let upper = text.to_ascii_uppercase();
    let in_base =
        |digits: &str, base| i64::from_str_radix(digits, base).ok().map(|whole| whole as f64);
    match upper.as_str() {
        "OFF" | "NEW" | "FALSE" => Some(0.0),
        "ON" | "OLD" | "TRUE" => Some(1.0),
        other => match other.get(..2) {
            Some("#H") => in_base(&other[2..], 16),
            Some("#O") => in_base(&other[2..], 8),
            Some("#B") => in_base(&other[2..], 2),
            _ => other.parse().ok().filter(|it: &f64| it.is_finite()),
        },
    }
}
