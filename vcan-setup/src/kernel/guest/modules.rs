//! Which module files make CAN, and in which order they are loaded.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

/// The modules a rehearsal needs, and those that CAN tools like to find: `cansniffer` needs bcm.
const WANTED: [&str; 8] =
    ["can", "can_raw", "can_dev", "vcan", "can_bcm", "can_gw", "vxcan", "can_isotp"];

/// The files to load, each after those it depends on. What the kernel was built without, or has
/// built in, is left out.
pub(super) fn load_order(folder: &Path) -> io::Result<Vec<PathBuf>> {
    let list = folder.join("modules.dep");
    let text = fs::read_to_string(&list)
        .map_err(|error| io::Error::new(error.kind(), format!("{}: {error}", list.display())))?;
    Ok(order(&text).into_iter().map(|file| folder.join(file)).collect())
}

/// The files of [`WANTED`] in the order of loading, from the text of `modules.dep`: a line for each
/// module, `FILE: FILE...`, the files it depends on last first (depmod(8)).
fn order(list: &str) -> Vec<&str> {
    let mut order = Vec::new();
    for name in WANTED {
        let line = list.lines().filter_map(|line| line.split_once(':'));
        let Some((file, needs)) = line.into_iter().find(|(file, _)| module_name(file) == name)
        else {
            continue;
        };
        for file in needs.split_whitespace().rev().chain([file]) {
            if !order.contains(&file) {
                order.push(file);
            }
        }
    }
    order
}

/// Name of the module in a file such as `kernel/net/can/can-raw.ko.xz`.
fn module_name(file: &str) -> String {
    let file = file.rsplit('/').next().unwrap_or(file);
    file.split(".ko").next().unwrap_or(file).replace('-', "_")
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIST: &str = "\
kernel/drivers/net/can/vcan.ko: kernel/drivers/net/can/dev/can-dev.ko
kernel/drivers/net/can/dev/can-dev.ko:
kernel/net/can/can-raw.ko.xz: kernel/net/can/can.ko.xz
kernel/net/can/can.ko.xz:
kernel/net/sched/em_canid.ko:
";

    #[test]
    fn a_module_comes_after_what_it_needs_and_only_once() {
        let files: Vec<String> = order(LIST).into_iter().map(module_name).collect();
        assert_eq!(files, ["can", "can_raw", "can_dev", "vcan"]);
    }

    #[test]
    fn needs_are_loaded_in_the_reverse_of_their_order() {
        let list = "a/vcan.ko: b/second.ko b/first.ko\n";
        assert_eq!(order(list), ["b/first.ko", "b/second.ko", "a/vcan.ko"]);
    }

    #[test]
    fn a_kernel_without_can_modules_has_none_to_load() {
        assert!(order("kernel/net/ax25/ax25.ko:\nnonsense\n").is_empty());
        assert!(load_order(Path::new("/nosuch")).is_err());
    }
}
