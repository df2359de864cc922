# Live motion from `motion-jax studio` on a Skeleton3D in Godot 4. Untested in Godot: only the
# syntax was checked (gdparse).
#
# Put this script on a Node, set `skeleton` to a character whose bones have the names of Godot's
# humanoid profile (retargeted on import) and whose rest pose is a T-pose, set `address` to what
# the studio printed, run the scene, and call say("a person jumps"). docs/protocol.md describes
# the messages.
extends Node

@export var address := "http://127.0.0.1:8765/?token=..."
@export var prompt := "a person walks forward"
@export var skeleton: Skeleton3D

var _socket := WebSocketPeer.new()
var _begun := false
var _parents: Array = []
var _bones: Array[int] = []
var _rows: Array[PackedFloat32Array] = []
var _rate := 50.0
var _clock := 0.0
var _scale := 1.0


func _ready() -> void:
	_socket.inbound_buffer_size = 1 << 20
	var parts := address.trim_prefix("http://").split("/?")
	if parts.size() != 2:
		push_error("motion_jax: expected an address such as http://127.0.0.1:8765/?token=...")
		set_process(false)
		return
	var error := _socket.connect_to_url("ws://%s/v1/stream?%s" % [parts[0], parts[1]])
	if error != OK:
		push_error("motion_jax: cannot connect to %s" % address)


func say(words: String) -> void:
	_send({"type": "prompt", "prompt": words})


func _send(message: Dictionary) -> void:
	_socket.send_text(JSON.stringify(message))


func _process(delta: float) -> void:
	_socket.poll()
	if _socket.get_ready_state() != WebSocketPeer.STATE_OPEN:
		return
	if not _begun:
		_begun = true
		_send({"type": "start", "prompt": prompt, "pose": "rig:vrm"})
	while _socket.get_available_packet_count() > 0:
		var packet := _socket.get_packet()
		if _socket.was_string_packet():
			_read_text(packet.get_string_from_utf8())
		elif packet[3] == 80:
			_read_poses(packet)
		else:
			_send({"type": "ack", "sequence": packet.decode_u32(8)})
	_clock = minf(_clock + delta * _rate, 10.0)
	while _clock >= 1.0 and not _rows.is_empty():
		_clock -= 1.0
		_apply(_rows.pop_front())


func _read_text(text: String) -> void:
	var message: Dictionary = JSON.parse_string(text)
	if message["type"] == "error":
		push_error("motion_jax: %s" % message["message"])
	if message["type"] == "started":
		_parents = message["pose"]["parents"]
		_rate = message["pose"]["fps"]
		_bones.clear()
		for joint in message["pose"]["joints"]:
			_bones.append(skeleton.find_bone(_bone_name(joint)))
		# Hips of the studio's body stand 0.9 m above the floor.
		_scale = skeleton.get_bone_global_rest(_bones[0]).origin.y / 0.9


# leftUpperArm of VRM is LeftUpperArm of Godot's humanoid profile.
func _bone_name(joint: String) -> String:
	return joint[0].to_upper() + joint.substr(1)


func _read_poses(packet: PackedByteArray) -> void:
	var header := packet.decode_u16(6)
	var count := packet.decode_u16(20)
	var width := packet.decode_u16(22)
	var values := packet.slice(header).to_float32_array()
	for k in count:
		_rows.append(values.slice(k * width, (k + 1) * width))


func _apply(row: PackedFloat32Array) -> void:
	# Both have y up and right-handed axes. Quaternions are w, x, y, z, relative to the parent.
	var turned: Array[Quaternion] = []
	for j in _bones.size():
		var at := 3 + 4 * j
		var local := Quaternion(row[at + 1], row[at + 2], row[at + 3], row[at]).normalized()
		var parent := int(_parents[j])
		turned.append(local if parent < 0 else turned[parent] * local)
		var bone := _bones[j]
		if bone < 0:
			continue
		var rest := skeleton.get_bone_global_rest(bone).basis.get_rotation_quaternion()
		var above := skeleton.get_bone_parent(bone)
		var world := turned[j] * rest
		var base := Quaternion.IDENTITY
		if above >= 0:
			base = skeleton.get_bone_global_pose(above).basis.get_rotation_quaternion()
		skeleton.set_bone_pose_rotation(bone, base.inverse() * world)
	if _bones[0] >= 0:
		var root := Vector3(row[0], row[1], row[2]) * _scale
		var hips_parent := skeleton.get_bone_parent(_bones[0])
		if hips_parent >= 0:
			root = skeleton.get_bone_global_pose(hips_parent).affine_inverse() * root
		skeleton.set_bone_pose_position(_bones[0], root)
