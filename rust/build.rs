//! Makes the static library from the tree, in OUT_DIR, and links it. README.md names the settings.

use std::env;
use std::path::Path;
use std::process::Command;

/// Before the names of the library's functions, as in src/ffi.rs: Open Image Denoise itself may be
/// in the same program.
const PREFIX: &str = "lull_rs";

/// An environment variable, of which the build script is to run again when it changes.
fn setting(name: &str) -> Option<String> {
    println!("cargo:rerun-if-env-changed={}", name);
    env::var(name).ok().filter(|value| !value.is_empty())
}

fn cargo(name: &str) -> String {
    env::var(name).unwrap_or_else(|_| panic!("lull: {} is not set; Cargo sets it", name))
}

/// A compiler setting by the names that Rust's build scripts usually know, the most special first.
fn tool(name: &str, target: &str, kind: &str) -> Option<String> {
    setting(&format!("{}_{}", name, target))
        .or_else(|| setting(&format!("{}_{}", name, target.replace('-', "_"))))
        .or_else(|| setting(&format!("{}_{}", kind, name)))
        .or_else(|| setting(name))
}

fn runs(compiler: &str) -> bool {
    let version = Command::new(compiler).arg("--version").output();
    matches!(version, Ok(output) if output.status.success())
}

/// GCC's usual name where it makes code for another machine. The C library may be another one, too:
/// then the processor is the same.
fn cross_compiler(target: &str, host: &str) -> String {
    let parts: Vec<&str> = target.split('-').collect();
    let cpu = match parts[0] {
        cpu if cpu.starts_with("armv7") || cpu.starts_with("thumbv7") => "arm",
        cpu if cpu.starts_with("riscv64") => "riscv64",
        cpu => cpu,
    };
    let system = parts[parts.len() - 1];
    let mut names = Vec::new();
    if target.contains("-linux-") {
        names.push(format!("{}-linux-{}-gcc", cpu, system));
        if system == "musl" && host.starts_with(parts[0]) {
            names.push("musl-gcc".to_string());
        }
    } else if target.contains("-windows-gnu") {
        names.push(format!("{}-w64-mingw32-gcc", cpu));
    }
    match names.iter().find(|name| runs(name)) {
        Some(found) => found.clone(),
        None => panic!(
            "lull: no C compiler for {}{}{}: set CC_{}",
            target,
            if names.is_empty() { "" } else { "; not found: " },
            names.join(", "),
            target.replace('-', "_")
        ),
    }
}

/// The archiver that belongs to a compiler.
fn archiver_of(compiler: &str) -> Option<String> {
    let mut words = compiler.split_whitespace();
    let mut command = Command::new(words.next()?);
    let output = command.args(words).arg("-print-prog-name=ar").output().ok()?;
    let name = String::from_utf8(output.stdout).ok()?.trim().to_string();
    Some(name).filter(|name| !name.is_empty())
}

/// Settings of the Makefile.
fn settings(out: &str) -> Vec<String> {
    let (target, host) = (cargo("TARGET"), cargo("HOST"));
    if target.ends_with("-msvc") {
        panic!("lull: {}: the library is made with GCC or Clang; use a -gnu target", target);
    }
    let kind = if target == host { "HOST" } else { "TARGET" };
    let mut made = vec![format!("BUILD={}/make", out)];
    made.extend(["SAN=", "OPENCL=0", "OPENEXR=0", "PNG=0"].map(String::from));

    let mut compiler = tool("CC", &target, kind);
    let mut archiver = tool("AR", &target, kind);
    if target != host {
        let found = compiler.unwrap_or_else(|| cross_compiler(&target, &host));
        archiver = archiver.or_else(|| archiver_of(&found));
        compiler = Some(found);
        if let Some(native) = setting("HOST_CC") {
            made.push(format!("HOSTCC={}", native));
        }
    }
    made.extend(compiler.map(|name| format!("CC={}", name)));
    made.extend(archiver.map(|name| format!("AR={}", name)));

    let mut flags = tool("CFLAGS", &target, kind).unwrap_or_default();
    flags += &format!(" -DOIDN_API_NAMESPACE={}", PREFIX);
    if cargo("DEBUG") == "true" {
        flags += " -g";
    }
    made.push(format!("CFLAGS={}", flags.trim()));

    // A denoiser without optimisation is of no use: by default it is -O3 in debug builds, too.
    let is_small = matches!(cargo("OPT_LEVEL").as_str(), "s" | "z");
    if setting("OPT").is_none() && is_small {
        made.push("OPT=-Os".to_string());
    }
    let more = setting("LULL_MAKEFLAGS").unwrap_or_default();
    made.extend(more.split_whitespace().map(String::from));
    made
}

fn main() {
    let out = cargo("OUT_DIR");
    let here = cargo("CARGO_MANIFEST_DIR");
    // Where a checkout has no symbolic links, the tree is above.
    let mut tree = Path::new(&here).join("tree");
    if !tree.join("lib/lull.h").is_file() {
        tree = Path::new(&here).join("..");
    }
    for part in ["Makefile", "apps/sources.mk", "lib", "oidn", "ports", "weights"] {
        println!("cargo:rerun-if-changed={}", tree.join(part).display());
    }
    println!("cargo:rerun-if-changed=build.rs");

    if out.contains(char::is_whitespace) {
        panic!("lull: {}: make wants a path without spaces: set CARGO_TARGET_DIR", out);
    }
    let library = format!("{}/make/lib/libOpenImageDenoise.a", out);
    let make = setting("MAKE").unwrap_or_else(|| "make".to_string());
    let mut command = Command::new(&make);
    command.args(settings(&out)).current_dir(&tree);
    match env::var("CARGO_MAKEFLAGS") {
        Ok(flags) => command.env("MAKEFLAGS", flags), // Cargo's jobs
        Err(_) => command.env_remove("MAKEFLAGS").arg(format!("-j{}", cargo("NUM_JOBS"))),
    };
    match command.arg(&library).status() {
        Ok(status) if status.success() => (),
        Ok(status) => panic!("lull: {} failed: {}", make, status),
        Err(error) => panic!("lull: {}: {}; GNU make and a C compiler are wanted", make, error),
    }

    // By a name of its own, so that nothing else finds the library in this folder.
    let own = format!("{}/liblull_rs.a", out);
    std::fs::copy(&library, &own).unwrap_or_else(|error| panic!("lull: {}: {}", own, error));
    println!("cargo:rustc-link-search=native={}", out);
    println!("cargo:rustc-link-lib=static=lull_rs");
}
