//! What the simulated camera answers to PTP operations: a memory card, a shutter, a battery.
//!
//! ISO 15740, clause 10 (operations) and 11 (responses), in the order of their codes.

use std::collections::BTreeMap;
use std::sync::Arc;

use beampose_core::Clock;

use super::packets::DataSet;
use crate::sim::Shutter;

/// Responses that this camera gives.
pub(super) mod response {
    pub(in super::super) const OK: u16 = 0x2001;
    pub(in super::super) const SESSION_NOT_OPEN: u16 = 0x2003;
    pub(in super::super) const OPERATION_NOT_SUPPORTED: u16 = 0x2005;
    pub(in super::super) const INVALID_STORAGE: u16 = 0x2008;
    pub(in super::super) const INVALID_OBJECT: u16 = 0x2009;
    pub(in super::super) const PROPERTY_NOT_SUPPORTED: u16 = 0x200a;
    pub(in super::super) const NO_THUMBNAIL: u16 = 0x2010;
    pub(in super::super) const INVALID_PARAMETER: u16 = 0x201d;
    pub(in super::super) const SESSION_ALREADY_OPEN: u16 = 0x201e;
    pub(in super::super) const GENERAL_ERROR: u16 = 0x2002;
}

const OPERATIONS: &[u16] = &[
    0x1001, 0x1002, 0x1003, 0x1004, 0x1005, 0x1006, 0x1007, 0x1008, 0x1009, 0x100a, 0x100b, 0x100e,
    0x1014, 0x1015, 0x101b,
];
/// Object added, object removed, capture complete.
const EVENTS: &[u16] = &[0x4002, 0x4003, 0x400d];
const BATTERY: u16 = 0x5001;
const JPEG: u16 = 0x3801;
const FOLDER: u16 = 0x3001;
const STORAGE: u32 = 0x0001_0001;
/// As a parameter: every storage, every object; as a parent: the root.
const ALL: u32 = 0xffff_ffff;
/// Handles of the two folders and of the first picture.
const DCIM: u32 = 0x1000;
const ROLL: u32 = 0x1001;
const FIRST: u32 = 0x2000;
/// Somebody took it before us: a camera's card is seldom empty.
const STRANGER: &[u8] = &[0xff, 0xd8, 0xff, 0xe0, 0, 4, b's', b'o', 0xff, 0xd9];

struct Object {
    parent: u32,
    format: u16,
    name: String,
    taken: String,
    bytes: Vec<u8>,
}

/// What an operation gives.
pub(super) struct Answer {
    pub(super) code: u16,
    pub(super) data: Option<Vec<u8>>,
    pub(super) parameters: Vec<u32>,
    /// Events that follow, with their parameters.
    pub(super) events: Vec<(u16, Vec<u32>)>,
}

impl Answer {
    pub(super) fn code(code: u16) -> Self {
        Self { code, data: None, parameters: Vec::new(), events: Vec::new() }
    }

    fn data(set: DataSet) -> Self {
        Self { data: Some(set.0), ..Self::code(response::OK) }
    }
}

/// A camera without its sockets.
pub(super) struct Body {
    serial: String,
    shutter: Arc<dyn Shutter>,
    clock: Arc<dyn Clock>,
    objects: BTreeMap<u32, Object>,
    next: u32,
    lose: bool,
    /// Taken, and not on the card yet.
    late: Option<Object>,
}

impl Body {
    pub(super) fn new(serial: String, shutter: Arc<dyn Shutter>, clock: Arc<dyn Clock>) -> Self {
        let folder = |parent, name: &str| Object {
            parent,
            format: FOLDER,
            name: name.to_owned(),
            taken: String::new(),
            bytes: Vec::new(),
        };
        let objects = BTreeMap::from([(DCIM, folder(0, "DCIM")), (ROLL, folder(DCIM, "100BEAMP"))]);
        let mut body =
            Self { serial, shutter, clock, objects, next: FIRST, lose: false, late: None };
        let stranger = body.picture(STRANGER.to_vec());
        body.store(stranger);
        body
    }

    pub(super) fn lose_next(&mut self) {
        self.lose = true;
    }

    fn picture(&self, bytes: Vec<u8>) -> Object {
        // 5.3.3.2: date and time as YYYYMMDDThhmmss.
        let taken = self.clock.now().utc.strftime("%Y%m%dT%H%M%S").to_string();
        Object { parent: ROLL, format: JPEG, name: String::new(), taken, bytes }
    }

    /// Puts a picture on the card. Names count up, as the handles do.
    fn store(&mut self, mut object: Object) -> u32 {
        let handle = self.next;
        self.next += 1;
        object.name = format!("DSC_{:04}.JPG", handle - FIRST + 1);
        self.objects.insert(handle, object);
        handle
    }

    /// Carries an operation out. Sessions are the business of whoever has the sockets.
    pub(super) fn operate(&mut self, code: u16, parameters: &[u32]) -> Answer {
        let parameter = |i: usize| parameters.get(i).copied().unwrap_or(0);
        let storage = parameter(0);
        let known_storage = storage == STORAGE || storage == ALL;
        match code {
            0x1001 => Answer::data(self.device_info()),
            0x1004 => Answer::data(DataSet::default().u32s(&[STORAGE])),
            0x1005 if storage == STORAGE => Answer::data(self.storage_info()),
            0x1006 | 0x1007 if known_storage => {
                let handles = self.handles(parameter(1), parameter(2));
                if code == 0x1007 {
                    return Answer::data(DataSet::default().u32s(&handles));
                }
                Answer { parameters: vec![handles.len() as u32], ..Answer::code(response::OK) }
            }
            0x1005..=0x1007 => Answer::code(response::INVALID_STORAGE),
            0x1008 | 0x1009 | 0x100a | 0x100b | 0x101b => self.of_object(code, parameters),
            0x100e => self.capture(),
            0x1014 | 0x1015 if storage == u32::from(BATTERY) => {
                let value = DataSet::default();
                if code == 0x1015 {
                    return Answer::data(value.u8(90));
                }
                // 13.3.3: code, UINT8, read only, factory and current value, a range of percents.
                let described = value.u16(BATTERY).u16(0x0002).u8(0).u8(100).u8(90);
                Answer::data(described.u8(1).u8(0).u8(100).u8(1))
            }
            0x1014 | 0x1015 => Answer::code(response::PROPERTY_NOT_SUPPORTED),
            _ => Answer::code(response::OPERATION_NOT_SUPPORTED),
        }
    }

    fn device_info(&self) -> DataSet {
        // 5.5.1; no vendor's extension, so that clients take the general way.
        DataSet::default()
            .u16(100)
            .u32(0)
            .u16(0)
            .text("")
            .u16(0)
            .u16s(OPERATIONS)
            .u16s(EVENTS)
            .u16s(&[BATTERY])
            .u16s(&[JPEG])
            .u16s(&[JPEG, FOLDER])
            .text("Beampose")
            .text("Simulated camera")
            .text("1.0")
            .text(&self.serial)
    }

    fn storage_info(&self) -> DataSet {
        // 5.5.3: removable, as digital cameras have it (DCF), read and write.
        let used: usize = self.objects.values().map(|object| object.bytes.len()).sum();
        let size = 8_000_000_000_u64;
        let set = DataSet::default().u16(4).u16(3).u16(0).u64(size).u64(size - used as u64);
        set.u32(1000).text("card").text("BEAMPOSE")
    }

    fn handles(&self, format: u32, parent: u32) -> Vec<u32> {
        // 10.4.7: no parent given means all, all ones means the root.
        let inside = |object: &Object| match parent {
            0 => true,
            ALL => object.parent == 0,
            parent => object.parent == parent,
        };
        let fits = |object: &Object| format == 0 || format == u32::from(object.format);
        let all = self.objects.iter().filter(|(_, object)| inside(object) && fits(object));
        all.map(|(handle, _)| *handle).collect()
    }

    fn of_object(&mut self, code: u16, parameters: &[u32]) -> Answer {
        let parameter = |i: usize| parameters.get(i).copied().unwrap_or(0) as usize;
        let handle = parameters.first().copied().unwrap_or(0);
        let Some(object) = self.objects.get(&handle) else {
            return Answer::code(response::INVALID_OBJECT);
        };
        match code {
            0x1008 => Answer::data(object_info(object)),
            0x1009 => Answer::data(DataSet(object.bytes.clone())),
            0x101b => {
                let rest = object.bytes.get(parameter(1)..).unwrap_or_default();
                let part = &rest[..parameter(2).min(rest.len())];
                let parameters = vec![part.len() as u32];
                Answer { parameters, ..Answer::data(DataSet(part.to_vec())) }
            }
            0x100a => Answer::code(response::NO_THUMBNAIL),
            _ => {
                self.objects.remove(&handle);
                Answer::code(response::OK)
            }
        }
    }

    /// 10.4.14: exposes, and tells of the picture by events.
    fn capture(&mut self) -> Answer {
        let Ok(bytes) = self.shutter.expose() else {
            return Answer::code(response::GENERAL_ERROR);
        };
        let own = self.picture(bytes);
        if std::mem::take(&mut self.lose) {
            self.late = Some(own);
            return Answer::code(response::OK);
        }
        let late = self.late.take();
        let mut events: Vec<(u16, Vec<u32>)> = late
            .into_iter()
            .chain([own])
            .map(|object| (0x4002, vec![self.store(object)]))
            .collect();
        events.push((0x400d, Vec::new()));
        Answer { events, ..Answer::code(response::OK) }
    }
}

/// 5.5.2.
fn object_info(object: &Object) -> DataSet {
    let is_folder = object.format == FOLDER;
    let set = DataSet::default()
        .u32(STORAGE)
        .u16(object.format)
        .u16(0)
        .u32(object.bytes.len() as u32)
        // No thumbnail; width, height and depth unknown.
        .u16(0)
        .u32(0)
        .u32(0)
        .u32(0)
        .u32(0)
        .u32(0)
        .u32(0)
        .u32(object.parent)
        .u16(u16::from(is_folder))
        .u32(0)
        .u32(0);
    set.text(&object.name).text(&object.taken).text(&object.taken).text("")
}
