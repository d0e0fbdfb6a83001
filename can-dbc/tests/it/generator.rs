//! What the generator refuses, it refuses by name.

#[path = "../../build/emit.rs"]
mod emit;
#[path = "../../build/layout.rs"]
mod layout;
#[path = "../../build/model.rs"]
mod model;
#[path = "../../build/names.rs"]
mod names;
#[path = "../../build/signal.rs"]
mod signal;
#[path = "../../build/tables.rs"]
mod tables;

use model::Contract;

const GOOD: &str = r#"VERSION ""

NS_ :

BS_:

BU_: Rig Ecu

BO_ 2566852736 Demo: 16 Rig
 SG_ E2eCrc : 0|16@1+ (1,0) [0|65535] "" Ecu
 SG_ E2eCounter : 16|8@1+ (1,0) [0|255] "" Ecu
 SG_ DemoPage M : 24|8@1+ (1,0) [0|1] "" Ecu
 SG_ Speed_0 m0 : 32|16@1- (0.01,0) [-327.68|327.67] "m/s" Ecu
 SG_ Speed_1 m1 : 32|16@1- (0.01,0) [-327.68|327.67] "m/s" Ecu

CM_ BO_ 2566852736 "A message.";
CM_ SG_ 2566852736 E2eCrc "CRC.";
CM_ SG_ 2566852736 E2eCounter "Counter.";
CM_ SG_ 2566852736 DemoPage "Page.";
CM_ SG_ 2566852736 Speed_0 "Speed.";
CM_ SG_ 2566852736 Speed_1 "Speed.";
BA_DEF_ BO_ "VFrameFormat" INT 0 15;
BA_DEF_ BO_ "GenMsgCycleTime" INT 0 65535;
BA_DEF_ BO_ "E2EDataId" INT 0 65535;
BA_DEF_ SG_ "GenSigStartValue" INT 0 65535;
BA_DEF_DEF_ "VFrameFormat" 15;
BA_DEF_DEF_ "GenMsgCycleTime" 10;
BA_DEF_DEF_ "E2EDataId" 5;
BA_DEF_DEF_ "GenSigStartValue" 0;
"#;

/// A parameter group with a value that may be missing, and one on Proprietary B.
const GOOD_J1939: &str = r#"VERSION ""

NS_ :

BS_:

BU_: Rig Ecu

BO_ 2566845184 SPEED: 8 Rig
 SG_ ParkingBrake : 2|2@1+ (1,0) [0|3] "" Ecu
 SG_ WheelSpeed : 8|16@1+ (0.00390625,0) [0|250.99609375] "km/h" Ecu

BO_ 2566856832 Order: 8 Rig
 SG_ Turn : 8|8@1+ (1,0) [0|253] "" Ecu
 SG_ MessageCounter : 56|4@1+ (1,0) [0|15] "" Ecu
 SG_ MessageChecksum : 60|4@1+ (1,0) [0|15] "" Ecu

CM_ BO_ 2566845184 "A group.";
CM_ SG_ 2566845184 ParkingBrake "Brake.";
CM_ SG_ 2566845184 WheelSpeed "Speed.";
CM_ BO_ 2566856832 "An order.";
CM_ SG_ 2566856832 Turn "Turn.";
CM_ SG_ 2566856832 MessageCounter "Counter.";
CM_ SG_ 2566856832 MessageChecksum "Checksum.";
BA_DEF_ BO_ "VFrameFormat" INT 0 15;
BA_DEF_ BO_ "GenMsgCycleTime" INT 0 65535;
BA_DEF_ BO_ "Protection" ENUM "none","TSC1","XBR","CRC8";
BA_DEF_ SG_ "SPN" INT 0 524287;
BA_DEF_ SG_ "GenSigStartValue" INT 0 65535;
BA_DEF_DEF_ "VFrameFormat" 3;
BA_DEF_DEF_ "GenMsgCycleTime" 100;
BA_DEF_DEF_ "Protection" "none";
BA_DEF_DEF_ "SPN" 0;
BA_DEF_DEF_ "GenSigStartValue" 0;
BA_ "Protection" BO_ 2566856832 2;
BA_ "SPN" SG_ 2566845184 ParkingBrake 70;
BA_ "SPN" SG_ 2566845184 WheelSpeed 84;
BA_ "GenSigStartValue" SG_ 2566845184 ParkingBrake 3;
BA_ "GenSigStartValue" SG_ 2566845184 WheelSpeed 65535;
BA_ "GenSigStartValue" SG_ 2566856832 Turn 255;
VAL_ 2566845184 ParkingBrake 0 "not set" 1 "set" 2 "error" 3 "not available" ;
VAL_ 2566845184 WheelSpeed 65024 "error" 65535 "not available" ;
VAL_ 2566856832 Turn 255 "not available" ;
"#;

fn refusal(good: &str, from: &str, to: &str) -> String {
    assert!(good.contains(from), "{from}");
    match Contract::read(&good.replace(from, to), None) {
        Ok(_) => panic!("accepted with {to}"),
        Err(refusal) => refusal,
    }
}

#[test]
fn a_good_dbc_is_understood() {
    let contract = Contract::read(GOOD, None).expect("good");
    let message = &contract.messages[0];
    let fields: Vec<_> = message.fields.iter().map(|field| field.name.as_str()).collect();
    assert_eq!(fields, ["page", "speed_mps"]);
    let data_id = message.protection.data_id();
    assert_eq!((message.id, message.cycle_time_ms, data_id), (0x18FF_1080, 10, Some(5)));
    assert_eq!((message.signals[3].raw_min, message.signals[3].raw_max), (-32_768, 32_767));
    let code = emit::code(&contract);
    for line in ["pub speed_mps: f64,", "pub page: u8,", "pub const ID: u32 = 0x18FF1080;"] {
        assert!(code.contains(line), "{line}");
    }
}

#[test]
fn numbered_signals_that_are_alike_become_an_array() {
    let flat = GOOD.replace(" m0", "").replace(" m1 : 32", " : 48").replace(" M : 24", " : 24");
    let contract = Contract::read(&flat, None).expect("good");
    let code = emit::code(&contract);
    for line in ["pub speed_mps: [f64; 2],", "speed_mps: codec::series(payload, &s[3..5])?,"] {
        assert!(code.contains(line), "{line}: {code}");
    }
    let unlike = flat.replace("Speed_1 : 48|16@1-", "Speed_1 : 48|12@1-");
    let unlike =
        unlike.replacen("48|12@1- (0.01,0) [-327.68|327.67]", "48|12@1- (0.01,0) [0|9]", 1);
    let refusal = Contract::read(&unlike, None).map(|_| ()).expect_err("unlike");
    assert!(refusal.contains("Speed_1: a series is of scaled, like numbers"), "{refusal}");
}

#[test]
fn each_fault_is_refused_with_its_place() {
    for (from, to, expected) in [
        ("BU_: Rig", "BU_ Rig Rig:", "not a DBC"),
        ("BO_ 2566852736 Demo", "BO_ 256 Demo", "29-bit"),
        ("Demo: 16", "Demo: 17", "17 bytes"),
        ("\"VFrameFormat\" 15", "\"VFrameFormat\" 14", "ExtendedCAN_FD"),
        ("\"E2EDataId\" 5", "\"E2EDataId\" 0", "E2EDataId 0"),
        ("\"GenMsgCycleTime\" 10", "\"GenMsgCycleTime\" 0", "GenMsgCycleTime 0"),
        ("E2eCounter : 16|8", "E2eCounter : 17|8", "E2eCounter must be at 16|8"),
        ("DemoPage M : 24|8", "DemoPage M : 25|8", "DemoPage and Speed_0 overlap"),
        ("Speed_1 m1 : 32|16@1", "Speed_1 m1 : 32|16@0", "Speed_1: Motorola"),
        ("Speed_1 m1 : 32|16", "Speed_1 m1 : 120|16", "Speed_1: bits 120|16"),
        ("Speed_1 m1 : 32|16", "Speed_1 m1 : 48|16", "Speed_1: pages must be alike"),
        ("Speed_1 m1", "Pace_1 m1", "Pace_1"),
        ("[0|1]", "[0|2]", "2 whole pages"),
        ("(0.01,0) [-327.68|327.67]", "(0.01,0) [-328|327.67]", "Speed_0: range"),
        ("(0.01,0)", "(0,0)", "Speed_0: factor 0"),
        ("\"m/s\"", "\"furlong\"", "no suffix for unit \"furlong\""),
        ("CM_ SG_ 2566852736 DemoPage \"Page.\";", "", "DemoPage: it has no CM_"),
        ("\"GenSigStartValue\" 0;", "\"GenSigStartValue\" 7;", "start value 7 is out of range"),
    ] {
        let refusal = refusal(GOOD, from, to);
        assert!(refusal.contains(expected), "{to}: {refusal}");
    }
}

#[test]
fn a_good_j1939_dbc_is_understood() {
    let contract = Contract::read(GOOD_J1939, None).expect("good");
    let code = emit::code(&contract);
    for line in [
        "pub struct Speed {",
        "pub parking_brake: ParkingBrake,",
        "pub wheel_speed_kmph: Reading<f64>,",
        "pub turn: Reading<u8>,",
        "pub const COUNTER_MAX: u8 = 15;",
        "pub fn encode(&self) -> Result<Frame, EncodeError> {",
        "pub fn encode(&self, counter: u8) -> Result<Frame, EncodeError> {",
        "protection: Protection::Xbr, counter: Some(1)",
        "spn: Some(84)",
    ] {
        assert!(code.contains(line), "{line}");
    }
    let codes = contract.messages[0].signals[1].codes.as_ref().expect("has codes");
    let found = (codes.error, codes.not_available_from, codes.not_available);
    assert_eq!(found, (Some(0xFE00), 0xFF00, 0xFFFF));
}

#[test]
fn each_fault_of_a_j1939_dbc_is_refused_with_its_place() {
    for (from, to, expected) in [
        ("SPEED: 8", "SPEED: 7", "message SPEED: 7 bytes; a parameter group here has 8"),
        ("\"SPN\" SG_ 2566845184 WheelSpeed 84", "\"SPN\" SG_ 2566845184 WheelSpeed 0", "no SPN"),
        ("65535 \"not", "65280 \"not", "WheelSpeed: \"not available\" must be 65535"),
        ("65024 \"error", "64000 \"error", "\"error\" 65024"),
        ("[0|250.99609375]", "[0|255]", "values below both"),
        ("WheelSpeed 65535;", "WheelSpeed 0;", "start value must be 65535, not available"),
        ("16@1+ (0.00390625,0) [0|250.99609375]", "16@1- (0.00390625,0) [0|120]", "unsigned"),
        ("\"Protection\" BO_ 2566856832 2", "\"Protection\" BO_ 2566856832 0", "MessageChecksum"),
        ("MessageCounter : 56|4", "MessageCounter : 48|4", "MessageCounter must be at 56|4"),
        ("MessageChecksum : 60|4", "MessageChecksum : 52|4", "MessageChecksum must be at 60|4"),
        ("\"VFrameFormat\" 3", "\"VFrameFormat\" 1", "J1939PG (3)"),
    ] {
        let refusal = refusal(GOOD_J1939, from, to);
        assert!(refusal.contains(expected), "{to}: {refusal}");
    }
}

#[test]
fn what_two_contracts_share_must_be_the_same_and_no_identifier_may_be() {
    let elder = Contract::read(GOOD_J1939, None).expect("good");
    let refused = |text: &str| Contract::read(text, Some(&elder)).map(|_| ()).expect_err("twins");
    assert!(refused(GOOD_J1939).contains("message SPEED: its id is taken"));
    let moved = GOOD_J1939.replace("2566845184", "2566845185").replace("2566856832", "2566856833");
    let younger = Contract::read(&moved, Some(&elder)).expect("the same value tables");
    assert!(emit::code(&younger).contains("pub use crate::messages::{ParkingBrake};"));
    let other = moved.replace("1 \"set\"", "1 \"applied\"");
    assert!(refused(&other).contains("value table ParkingBrake differs"));
}

#[test]
fn names_follow_the_house_style() {
    assert_eq!(names::snake_case("PositionX"), "position_x");
    assert_eq!(names::constant_case("V2vState"), "V2V_STATE");
    assert_eq!(names::variant("held previous plan").as_deref(), Some("HeldPreviousPlan"));
    assert_eq!(names::variant("3rd"), None);
    assert_eq!(names::unit_suffix("rad/s"), Some("_radps"));
    assert_eq!(names::unit_suffix("km/h"), Some("_kmph"));
    assert_eq!(["TSC1", "XBR", "NavTime"].map(names::type_name), ["Tsc1", "Xbr", "NavTime"]);
}
