//! A tethering program that fills folders: one for each camera, with a port at which it takes
//! releases and answers when the picture is in place.
//!
//! Traps kept: a picture is written in place, piece by piece; other files lie in the folder (a
//! preview under a hidden name, a text); a picture that got lost turns up late, right before the
//! next one.

use std::io::{BufRead, BufReader, Write};
use std::net::{Ipv4Addr, TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use crate::sim::{Hosted, Shutter, Simulated};
use crate::transport::Address;

/// Folders that fill.
pub struct TetheredFolder {
    cameras: Vec<Arc<Tethered>>,
    threads: Vec<JoinHandle<()>>,
    shared: Arc<Shared>,
    _folder: tempfile::TempDir,
}

#[derive(Default)]
struct Shared {
    ended: AtomicBool,
    lose: AtomicBool,
}

struct Tethered {
    name: String,
    folder: PathBuf,
    shutter: Arc<dyn Shutter>,
    roll: Mutex<Roll>,
}

#[derive(Default)]
struct Roll {
    count: u32,
    /// Taken, and not delivered in time.
    late: Option<(String, Vec<u8>)>,
}

pub(super) fn simulate(all: &[Simulated]) -> Result<Box<dyn Hosted>, String> {
    let io = |error: std::io::Error| error.to_string();
    let folder = tempfile::Builder::new().prefix("beampose-folder-").tempdir().map_err(io)?;
    let shared = Arc::new(Shared::default());
    let (mut cameras, mut threads) = (Vec::new(), Vec::new());
    for (number, it) in all.iter().enumerate() {
        // The name may hold what no file name does.
        let own = folder.path().join(format!("camera{number}"));
        std::fs::create_dir(&own).map_err(io)?;
        std::fs::write(own.join("readme.txt"), "pictures come here").map_err(io)?;
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).map_err(io)?;
        listener.set_nonblocking(true).map_err(io)?;
        let place = listener.local_addr().map_err(io)?;
        std::fs::write(own.join(".beampose-release"), format!("tcp:{place}\n")).map_err(io)?;
        let camera = Arc::new(Tethered {
            name: it.name.clone(),
            folder: own,
            shutter: it.part.shutter()?,
            roll: Mutex::default(),
        });
        cameras.push(Arc::clone(&camera));
        let shared = Arc::clone(&shared);
        let serve = move || camera.serve(&listener, &shared);
        threads.push(std::thread::Builder::new().spawn(serve).map_err(io)?);
    }
    Ok(Box::new(TetheredFolder { cameras, threads, shared, _folder: folder }))
}

impl Hosted for TetheredFolder {
    fn address(&self, name: &str) -> Option<Address> {
        let camera = self.cameras.iter().find(|camera| camera.name == name)?;
        Some(Address::Folder(camera.folder.clone()))
    }

    fn lose_next(&self) {
        self.shared.lose.store(true, Ordering::SeqCst);
    }
}

impl Drop for TetheredFolder {
    fn drop(&mut self) {
        self.shared.ended.store(true, Ordering::SeqCst);
        for thread in self.threads.drain(..) {
            let _ = thread.join();
        }
    }
}

impl Tethered {
    fn serve(&self, listener: &TcpListener, shared: &Shared) {
        while !shared.ended.load(Ordering::SeqCst) {
            match listener.accept() {
                // A client that leaves is no fault of ours.
                Ok((stream, _)) => drop(self.answer(stream, shared)),
                Err(_) => std::thread::sleep(Duration::from_millis(1)),
            }
        }
    }

    fn answer(&self, mut stream: TcpStream, shared: &Shared) -> std::io::Result<()> {
        stream.set_nonblocking(false)?;
        stream.set_read_timeout(Some(Duration::from_millis(500)))?;
        let mut line = String::new();
        BufReader::new(&stream).read_line(&mut line)?;
        let answer = match line.trim_end() {
            "RELEASE" => match self.take(shared) {
                Ok(()) => "OK\n".to_owned(),
                Err(why) => format!("ERROR {why}\n"),
            },
            _ => "ERROR it knows RELEASE only\n".to_owned(),
        };
        stream.write_all(answer.as_bytes())
    }

    fn take(&self, shared: &Shared) -> Result<(), String> {
        let bytes = self.shutter.expose()?;
        let mut roll = self.roll.lock().unwrap_or_else(PoisonError::into_inner);
        roll.count += 1;
        let name = format!("IMG_{:04}.JPG", roll.count);
        if shared.lose.swap(false, Ordering::SeqCst) {
            roll.late = Some((name, bytes));
            return Ok(());
        }
        if let Some((name, bytes)) = roll.late.take() {
            drop_into(&self.folder, &name, &bytes).map_err(|error| error.to_string())?;
        }
        drop_into(&self.folder, &name, &bytes).map_err(|error| error.to_string())
    }
}

fn drop_into(folder: &Path, name: &str, bytes: &[u8]) -> std::io::Result<()> {
    std::fs::write(folder.join(format!("._{name}")), &bytes[..bytes.len() / 8])?;
    let mut file = std::fs::File::create(folder.join(name))?;
    for piece in bytes.chunks(1 << 16) {
        file.write_all(piece)?;
    }
    Ok(())
}
