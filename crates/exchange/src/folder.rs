//! A folder that somebody else wrote: nothing outside it is read, whatever it says.

use std::fs::File;
use std::io::Read as _;
use std::path::{Component, Path, PathBuf};

use beampose_plan::source::unreadable;

/// No file of a session is larger, in MB: a picture of 100 megapixels has less.
const LIMIT_MB: u64 = 200;

/// A folder that is there.
pub struct Folder {
    shown: PathBuf,
    real: PathBuf,
}

impl Folder {
    /// The folder at `path`.
    ///
    /// # Errors
    /// That there is none, for people.
    pub fn open(path: &Path) -> Result<Self, String> {
        let shown = path.display();
        let real = path.canonicalize().map_err(|error| match error.kind() {
            std::io::ErrorKind::NotFound => format!("{shown}: no such folder"),
            _ => unreadable(&shown.to_string(), &error).to_string(),
        })?;
        if !real.is_dir() {
            return Err(format!("{shown} is a file, not a folder"));
        }
        Ok(Self { shown: path.to_path_buf(), real })
    }

    /// A file's name as people should see it.
    pub fn shown(&self, name: &str) -> String {
        self.shown.join(name).display().to_string()
    }

    /// Checks without reading that a file is there, within the folder, and of a size to be read.
    ///
    /// # Errors
    /// Why it cannot be read, for people, without its name.
    pub fn check(&self, name: &str) -> Result<(), String> {
        self.resolve(name).map(|_| ())
    }

    /// The bytes of a file.
    ///
    /// # Errors
    /// As [`Folder::check`].
    pub fn bytes(&self, name: &str) -> Result<Vec<u8>, String> {
        let path = self.resolve(name)?;
        let said = |error: std::io::Error| unreadable(name, &error).message;
        let mut bytes = Vec::new();
        let limit = LIMIT_MB * 1_000_000 + 1;
        File::open(path).map_err(said)?.take(limit).read_to_end(&mut bytes).map_err(said)?;
        check_size(bytes.len() as u64)?;
        Ok(bytes)
    }

    fn resolve(&self, name: &str) -> Result<PathBuf, String> {
        let path = Path::new(name);
        for component in path.components() {
            match component {
                Component::Normal(_) | Component::CurDir => {}
                Component::ParentDir => {
                    return Err("`..` is refused: files stay inside the folder".to_owned());
                }
                Component::RootDir | Component::Prefix(_) => {
                    return Err(
                        "an absolute path is refused: files stay inside the folder".to_owned()
                    );
                }
            }
        }
        let said = |error: std::io::Error| unreadable(name, &error).message;
        let real = self.real.join(path).canonicalize().map_err(said)?;
        if !real.starts_with(&self.real) {
            return Err("a link that leads outside the folder is refused".to_owned());
        }
        let found = real.metadata().map_err(said)?;
        if found.is_dir() {
            return Err("expected a file, found a directory".to_owned());
        }
        if !found.is_file() {
            return Err("it is not a regular file".to_owned());
        }
        check_size(found.len())?;
        Ok(real)
    }
}

fn check_size(bytes: u64) -> Result<(), String> {
    if bytes > LIMIT_MB * 1_000_000 {
        return Err(format!("the file has {bytes} bytes; at most {LIMIT_MB} MB are read"));
    }
    Ok(())
}
