//! A folder to run the program in, and short plans.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use beampose_store::Store;
use serde_json::Value;

/// The smallest at which every capture of the default rig is solved: at 0.34 targets are too small.
pub const SCALE: &str = "0.5";

/// What the program may take, on a machine that is busy with other things.
const PATIENCE: Duration = Duration::from_secs(150);

/// The folder with the plans and rigs that the program comes with.
pub fn experiments() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../experiments").canonicalize().unwrap()
}

/// The default rig.
pub fn rig() -> String {
    experiments().join("rigs/simulated.yaml").display().to_string()
}

/// `text` with every `from` replaced; there must be one.
#[track_caller]
pub fn replaced(text: &str, from: &str, to: &str) -> String {
    assert!(text.contains(from), "no {from:?} in\n{text}");
    text.replace(from, to)
}

/// The translation test as it is shipped.
pub fn full_plan() -> String {
    std::fs::read_to_string(experiments().join("plans/translation-test.yaml")).unwrap()
}

/// The translation test with fewer passes, and stops from 0 to `to` in steps of `step` (mm).
pub fn plan(passes: u32, to: u32, step: u32) -> String {
    let text = replaced(&full_plan(), "rig: ../rigs/simulated.yaml\n", "");
    let text = replaced(&text, "passes: 6", &format!("passes: {passes}"));
    let text = replaced(&text, "to: 900 mm", &format!("to: {to} mm"));
    replaced(&text, "step: 100 mm", &format!("step: {step} mm"))
}

/// The translation test with turned captures, shortened: eight turned ones, a pass of three stops.
pub fn turned_plan() -> String {
    let path = experiments().join("plans/translation-test-turned.yaml");
    let text = std::fs::read_to_string(path).unwrap();
    let text = replaced(&text, "rig: ../rigs/simulated.yaml\n", "");
    let text = replaced(&text, "passes: 6", "passes: 1");
    let text = replaced(&text, "to: 900 mm", "to: 200 mm");
    let text = replaced(&text, "places: 450 mm", "places: 200 mm");
    replaced(&text, "turn: 0.5 deg", "turn: 8 deg")
}

/// Sends the program a signal.
#[cfg(unix)]
pub fn signal(run: &std::process::Child, signal: &str) {
    let kill = format!("kill -{signal} {}", run.id());
    assert!(std::process::Command::new("sh").args(["-c", &kill]).status().unwrap().success());
}

/// How the program ended, and what it said.
#[derive(Debug)]
pub struct Ended {
    pub code: i32,
    pub out: String,
    pub err: String,
}

impl Ended {
    pub fn of(output: &std::process::Output) -> Self {
        let text = |bytes: &[u8]| String::from_utf8(bytes.to_vec()).unwrap();
        let code = output.status.code().unwrap_or_else(|| panic!("killed: {output:?}"));
        let ended = Self { code, out: text(&output.stdout), err: text(&output.stderr) };
        assert!(!ended.err.contains("panicked"), "{}", ended.err);
        ended
    }

    /// Fails unless the exit code is this one.
    #[track_caller]
    pub fn expect_code(self, code: i32) -> Self {
        assert_eq!(self.code, code, "{}\n{}", self.out, self.err);
        self
    }

    /// Standard output as one JSON object a line.
    #[track_caller]
    pub fn json_lines(&self) -> Vec<Value> {
        self.out.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
    }

    /// Standard output as one JSON object.
    #[track_caller]
    pub fn json(&self) -> Value {
        let mut lines = self.json_lines();
        assert_eq!(lines.len(), 1, "{}", self.out);
        lines.remove(0)
    }
}

/// A folder that goes with its test.
pub struct Lab {
    folder: tempfile::TempDir,
}

impl Lab {
    pub fn new() -> Self {
        Self { folder: tempfile::tempdir().unwrap() }
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    pub fn write(&self, name: &str, text: &str) {
        std::fs::create_dir_all(self.path(name).parent().unwrap()).unwrap();
        std::fs::write(self.path(name), text).unwrap();
    }

    /// Writes a rig to `rigs/NAME.yaml`, beside the files that the default rig refers to.
    pub fn write_rig(&self, name: &str, text: &str) {
        self.write(&format!("rigs/{name}.yaml"), text);
        for entry in std::fs::read_dir(experiments().join("rigs/simulated")).unwrap() {
            let path = entry.unwrap().path();
            let name = format!("rigs/simulated/{}", path.file_name().unwrap().to_str().unwrap());
            self.write(&name, &std::fs::read_to_string(path).unwrap());
        }
    }

    /// The program, about to run in this folder.
    pub fn command(&self) -> std::process::Command {
        let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_beampose"));
        command.current_dir(self.folder.path());
        for variable in ["DATABASE_URL", "RUST_LOG", "RAYON_NUM_THREADS"] {
            command.env_remove(variable);
        }
        command
    }

    /// Runs the program to its end.
    pub fn beampose(&self, arguments: &[&str]) -> Ended {
        let mut command = self.command();
        command.args(arguments);
        Ended::of(&assert_cmd::Command::from_std(command).timeout(PATIENCE).output().unwrap())
    }

    /// Runs a plan on the default rig with small pictures and no progress bar, JSON out.
    pub fn run(&self, plan: &str, more: &[&str]) -> Ended {
        self.write("plan.yaml", plan);
        let rig = rig();
        let usual = [
            "run",
            "plan.yaml",
            "--rig",
            &rig,
            "--picture-scale",
            SCALE,
            "--json",
            "--out",
            "report",
        ];
        self.beampose(&[&usual, more].concat())
    }

    /// Does something with the database.
    pub fn with_store<T>(&self, database: &str, work: impl AsyncFnOnce(Arc<Store>) -> T) -> T {
        let path = self.path(database);
        tokio::runtime::Runtime::new().unwrap().block_on(async {
            let store = Arc::new(Store::open(&path).await.unwrap());
            work(store).await
        })
    }
}

/// What `solve --json` prints of each capture and method, without the time it took.
#[track_caller]
pub fn solutions(ended: &Ended) -> Vec<Value> {
    let mut lines = ended.json_lines();
    let last = lines.pop().unwrap();
    assert!(last["session"].is_string(), "{last}");
    for line in &mut lines {
        assert!(line.as_object_mut().unwrap().remove("seconds").is_some(), "{line}");
    }
    lines
}
