# Godot 3: what an AnimationPlayer shows at the end of a looped clip against its beginning.
#   godot3-server --path FOLDER -e -q                          imports the .glb files of a folder with a project.godot
#   FILES="walk idle" godot3-server --path FOLDER -s godot_seam.gd
extends SceneTree


func find(node, kind):
	if node.is_class(kind):
		return node
	for child in node.get_children():
		var hit = find(child, kind)
		if hit:
			return hit
	return null


func pose(player, skeleton, name, time):
	player.play(name)
	player.seek(time, true)
	var bones = []
	for bone in skeleton.get_bone_count():
		bones.append(skeleton.get_bone_global_pose(bone))
	return bones


func _init():
	for file in OS.get_environment("FILES").split(" "):
		var scene = load("res://%s.glb" % file).instance()
		get_root().add_child(scene)
		var player = find(scene, "AnimationPlayer")
		var skeleton = find(scene, "Skeleton")
		var name = player.get_animation_list()[0]
		var length = player.get_animation(name).length
		var first = pose(player, skeleton, name, 0.0)
		var last = pose(player, skeleton, name, length)
		var apart = 0.0
		var turned = 0.0
		for bone in first.size():
			apart = max(apart, first[bone].origin.distance_to(last[bone].origin))
			var q = first[bone].basis.get_rotation_quat()
			turned = max(turned, rad2deg(2 * acos(min(1.0, abs(q.dot(last[bone].basis.get_rotation_quat()))))))
		print("%s %s: %.3f s, bones %.2f mm and %.2f degrees apart; %s goes %s" % [file, name, length, 1000 * apart,
			turned, skeleton.get_bone_name(0), last[0].origin - first[0].origin])
	quit()
