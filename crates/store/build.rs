//! Rebuilds when a migration is added: `migrate!` alone notices only edits of known files.

fn main() {
    println!("cargo:rerun-if-changed=../../migrations");
}
