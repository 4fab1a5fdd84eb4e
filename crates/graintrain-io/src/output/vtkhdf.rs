//! Frames as one temporal VTKHDF file, which ParaView reads.
//!
//! The four groups of cells have to be there, empty ones too, or VTK reads no points. `/ONDEM` has the names
//! of the draft of ON-DEM.
//!
//! Source: docs.vtk.org, VTKHDF file format 2.1, temporal PolyData.

use super::exchange::{Array, Snapshot};
use hdf5_pure::{AttrValue, FileBuilder, GroupBuilder};
use std::io;

/// Groups of cells, in the order of the columns of their offsets.
const CELLS: [&str; 4] = ["Vertices", "Lines", "Polygons", "Strips"];

/// Arrays of frames with their names in ON-DEM.
const ONDEM: [(&str, &str); 6] = [
    ("body", "body_id"),
    ("type", "material_id"),
    ("v", "velocity"),
    ("omega", "angular_velocity"),
    ("quat", "orientation"),
    ("mass", "mass"),
];

/// Running sums: where each frame begins.
fn starts(counts: &[i64]) -> Vec<i64> {
    let begin = |sum: &mut i64, count: &i64| {
        let start = *sum;
        *sum += count;
        Some(start)
    };
    counts.iter().scan(0, begin).collect()
}

fn refused(error: impl std::fmt::Display) -> io::Error {
    io::Error::other(error.to_string())
}

/// The arrays that all frames have, frame after frame.
fn joined(snapshots: &[Snapshot]) -> Vec<Array> {
    let Some(first) = snapshots.first() else { return Vec::new() };
    let everywhere = |array: &&Array| {
        snapshots.iter().all(|s| s.array(array.name).is_some_and(|a| a.components == array.components))
    };
    first
        .arrays
        .iter()
        .filter(everywhere)
        .map(|array| {
            let values = snapshots.iter().filter_map(|s| s.array(array.name)).flat_map(|a| a.values.clone());
            Array { values: values.collect(), ..array.clone() }
        })
        .collect()
}

fn add(group: &mut GroupBuilder, name: &str, array: &Array) {
    let count = (array.values.len() / array.components.max(1)) as u64;
    let shape: &[u64] = if array.components == 1 { &[count] } else { &[count, array.components as u64] };
    let dataset = group.create_dataset(name);
    if array.is_whole {
        let whole: Vec<i64> = array.values.iter().map(|&value| value as i64).collect();
        dataset.with_i64_data(&whole).with_shape(shape);
    } else {
        dataset.with_f64_data(&array.values).with_shape(shape);
    }
}

/// The file's bytes.
///
/// # Errors
/// Where the HDF5 writer refuses them.
pub fn bytes(snapshots: &[Snapshot]) -> io::Result<Vec<u8>> {
    let counts: Vec<i64> = snapshots.iter().map(|s| s.position.len() as i64).collect();
    let (steps, begins) = (snapshots.len() as i64, starts(&counts));
    let arrays = joined(snapshots);
    let points: Vec<f64> =
        snapshots.iter().flat_map(|s| s.position.iter().flat_map(|p| p.to_array())).collect();
    let mut file = FileBuilder::new();
    let mut root = file.create_group("VTKHDF");
    root.set_attr("Version", AttrValue::I64Array(vec![2, 1]));
    root.set_attr("Type", AttrValue::ascii_string_sized("PolyData", 8).map_err(refused)?);
    root.create_dataset("NumberOfPoints").with_i64_data(&counts);
    root.create_dataset("Points").with_f64_data(&points).with_shape(&[points.len() as u64 / 3, 3]);
    let mut data = root.create_group("PointData");
    arrays.iter().for_each(|array| add(&mut data, array.name, array));
    root.add_group(data.finish());
    for name in CELLS {
        let mut cells = root.create_group(name);
        let is_used = name == CELLS[0];
        let number = if is_used { counts.clone() } else { vec![0; counts.len()] };
        let connectivity: Vec<i64> =
            counts.iter().flat_map(|&count| 0..if is_used { count } else { 0 }).collect();
        let offsets: Vec<i64> =
            counts.iter().flat_map(|&count| 0..=if is_used { count } else { 0 }).collect();
        cells.create_dataset("NumberOfCells").with_i64_data(&number);
        cells.create_dataset("NumberOfConnectivityIds").with_i64_data(&number);
        cells
            .create_dataset("Connectivity")
            .with_i64_data(&connectivity)
            .with_shape(&[connectivity.len() as u64]);
        cells.create_dataset("Offsets").with_i64_data(&offsets);
        root.add_group(cells.finish());
    }
    let mut time = root.create_group("Steps");
    time.set_attr("NSteps", AttrValue::I64(steps));
    let times: Vec<f64> = snapshots.iter().map(|s| s.time).collect();
    time.create_dataset("Values").with_f64_data(&times);
    time.create_dataset("PartOffsets").with_i64_data(&(0..steps).collect::<Vec<_>>());
    time.create_dataset("NumberOfParts").with_i64_data(&vec![1; snapshots.len()]);
    time.create_dataset("PointOffsets").with_i64_data(&begins);
    let by_kind: Vec<i64> = begins.iter().flat_map(|&begin| [begin, 0, 0, 0]).collect();
    for name in ["CellOffsets", "ConnectivityIdOffsets"] {
        time.create_dataset(name).with_i64_data(&by_kind).with_shape(&[steps as u64, 4]);
    }
    let mut offsets = time.create_group("PointDataOffsets");
    for array in &arrays {
        offsets.create_dataset(array.name).with_i64_data(&begins);
    }
    time.add_group(offsets.finish());
    root.add_group(time.finish());
    file.add_group(root.finish());
    let mut ondem = file.create_group("ONDEM");
    for (name, value) in [("file_format", "ON-DEM VTKHDF"), ("file_format_version", "0.1-draft")] {
        let width = value.len() as u32;
        ondem.set_attr(name, AttrValue::ascii_string_sized(value, width).map_err(refused)?);
    }
    let mut state = ondem.create_group("state");
    state.create_dataset("time").with_f64_data(&times);
    state.create_dataset("offset").with_i64_data(&begins);
    state.create_dataset("position").with_f64_data(&points).with_shape(&[points.len() as u64 / 3, 3]);
    for (name, there) in ONDEM {
        if let Some(array) = arrays.iter().find(|array| array.name == name) {
            add(&mut state, there, array);
        }
    }
    ondem.add_group(state.finish());
    file.add_group(ondem.finish());
    file.finish().map_err(refused)
}
