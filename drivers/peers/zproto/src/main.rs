//! zproto, a crate of other people, drives our Zaber simulator over TCP and over a pty:
//! `peer-zproto SIMULATOR`.

use std::error::Error;
use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::net::TcpStream;
use std::process::{Child, Command, Stdio};

use zproto::ascii::Port;
use zproto::ascii::response::check;
use zproto::backend::Backend;

type Outcome<T> = Result<T, Box<dyn Error>>;

/// Our simulator, as a program of its own, and its address. It ends with its standard input.
fn simulator(program: &str, place: &str) -> Outcome<(Child, String)> {
    let mut child = Command::new(program)
        .args(["linear_axis", "zaber", place, "steps_per_unit=10000"])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()?;
    let mut address = String::new();
    BufReader::new(child.stdout.take().ok_or("no output")?).read_line(&mut address)?;
    Ok((child, address.trim().to_owned()))
}

/// Where the stage stands in the end, in microsteps.
fn drive<B: Backend>(port: &mut Port<'_, B>) -> Outcome<i32> {
    port.command_reply((1, 1, "home"))?.flag_ok()?;
    port.poll_until_idle((1, 1), check::flag_ok_and(check::warning_is_none()))?;
    port.command_reply((1, 1, "move abs 20000"))?.flag_ok_and(check::status_busy())?;
    port.poll_until_idle((1, 1), check::flag_ok_and(check::warning_is_none()))?;
    port.command_reply((1, 1, "get pos"))?.check(check::parsed_data_is(20_000))?;
    // Out of reach: refused, and nothing moves.
    let refused = port.command_reply((1, 1, "move abs 10000000"))?.check(check::flag_rj())?;
    assert_eq!(refused.data(), "BADDATA");
    let unknown = port.command_reply((1, "frobnicate"))?.check(check::flag_rj())?;
    assert_eq!(unknown.data(), "BADCOMMAND");
    // Interrupted on the way: the flag says so, until it is cleared.
    port.command_reply((1, 1, "move max"))?.flag_ok_and(check::status_busy())?;
    port.poll_until((1, 1, "get pos"), check::flag_ok(), |reply| {
        reply.data().parse::<i32>().is_ok_and(|at| at >= 100_000)
    })?;
    port.command_reply((1, 1, "stop"))?.flag_ok_and(check::warning_is("NI"))?;
    port.command_reply((1, 1, "warnings clear"))?.flag_ok()?;
    port.command_reply((1, 1, ""))?.flag_ok_and(check::warning_is_none())?;
    // Without message number and check sum too.
    port.set_message_ids(false);
    port.set_checksums(false);
    let reply = port.command_reply((1, 1, "get pos"))?.flag_ok()?;
    Ok(reply.data().parse()?)
}

fn main() -> Outcome<()> {
    let program = std::env::args().nth(1).ok_or("SIMULATOR is missing")?;
    let (mut child, address) = simulator(&program, "tcp:127.0.0.1:0")?;
    let socket = address.strip_prefix("tcp:").ok_or("no TCP address")?;
    let at = drive(&mut Port::open_tcp(socket)?)?;
    // What the simulator itself says, beside the peer.
    let mut beside = TcpStream::connect(socket)?;
    beside.write_all(b"/1 1 get pos\n")?;
    let mut answer = [0; 64];
    let count = beside.read(&mut answer)?;
    let answer = String::from_utf8_lossy(&answer[..count]).into_owned();
    assert!(answer.contains(&format!(" {at}:")), "{answer} {at}");
    drop(child.stdin.take());
    child.wait()?;

    let link = std::env::temp_dir().join(format!("peer-zproto-{}", std::process::id()));
    let (mut child, address) = simulator(&program, &format!("pty:{}", link.display()))?;
    assert!(drive(&mut Port::open_serial(&address)?)? >= 100_000);
    drop(child.stdin.take());
    child.wait()?;
    println!(
        "zproto 0.4.2, TCP and pty: homes, moves, is refused with the right words, interrupts a \
         move and sees its flag, with and without numbers and check sums"
    );
    Ok(())
}
