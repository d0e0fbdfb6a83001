//! Tables on a terminal.

use comfy_table::{CellAlignment, Table};

/// A line under the header and nothing else.
const RULED: &str = "     ──            ";

/// A table whose columns after the first line up on the right.
pub fn ruled(header: &[&str]) -> Table {
    let mut table = Table::new();
    table.load_preset(RULED).set_header(header);
    for column in table.column_iter_mut().skip(1) {
        column.set_cell_alignment(CellAlignment::Right);
    }
    table
}

/// A number with at most three digits behind the point, without trailing zeros.
pub fn number(x: f64) -> String {
    let rounded = format!("{x:.3}");
    rounded.trim_end_matches('0').trim_end_matches('.').to_owned()
}
