"""Brings a model of ibgs into Blender 4.2 or newer: its cameras, with the photos behind them, and its Gaussians.

    blender --python examples/blender_import.py -- MODEL --photos SCENE/images
    blender --background --python examples/blender_import.py -- MODEL --render view_000.png --output view.png

MODEL is a folder that `ibgs train` wrote. The Gaussians are those of its first base, in the constant part of their
colours: points with attributes, and geometry nodes that show an ellipsoid at each. Cycles renders them with their
falloff, sorted by where a ray meets them. The residual needs ibgs: render it there with a camera path. The same script
runs as `python3 blender_import.py MODEL` where the package `bpy` is installed.
"""

import argparse
import json
import math
import pathlib
import sys

import bpy
import numpy as np
from mathutils import Matrix

SENSOR = 36.0  # millimetres
SIGMAS = 3.0  # radius of an ellipsoid in standard deviations
SH_DEGREE_0 = 0.28209479177387814  # value of the constant spherical harmonic
LEAST_OPACITY = 0.02
NEEDED = "x y z opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3 f_dc_0 f_dc_1 f_dc_2".split()


def read_gaussians(path):
    """The columns of a binary PLY of Gaussians by name, and its offset."""
    data = path.read_bytes()
    end = data.find(b"end_header\n")
    if not data.startswith(b"ply\n") or end < 0:
        sys.exit(f"{path}: not a PLY file")
    lines = data[:end].decode("ascii").splitlines()
    if "format binary_little_endian 1.0" not in lines:
        sys.exit(f"{path}: only binary little-endian PLY files are read")
    properties = [line.split()[1:] for line in lines if line.startswith("property ")]
    others = [name for kind, *_, name in properties if kind != "float"]
    if others:
        sys.exit(f"{path}: the property `{others[0]}` is no float, so these are no Gaussians")
    names = [name for _, name in properties]
    count = next((int(line.split()[2]) for line in lines if line.startswith("element vertex ")), 0)
    if len(data) < end + len(b"end_header\n") + 4 * count * len(names):
        sys.exit(f"{path}: ends before its {count} vertices do")
    offsets = [line.split()[2:5] for line in lines if line.startswith("comment offset ")]
    values = np.frombuffer(data, "<f4", count * len(names), end + len(b"end_header\n")).reshape(count, len(names))
    offset = np.array(offsets[0], float) if offsets else np.zeros(3)
    missing = set(NEEDED) - set(names)
    if missing:
        sys.exit(f"{path}: has no {', '.join(sorted(missing))}, so these are no Gaussians")
    return {name: values[:, i] for i, name in enumerate(names)}, offset


def linear(srgb):
    """Light of an sRGB value, which Blender computes with."""
    srgb = np.clip(srgb, 0.0, 1.0)
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)


def add_cameras(records, photos, origin):
    """A camera for each view, at its place less the origin, and its photo behind it. Returns them by the photos' names."""
    made = {}
    collection = bpy.data.collections.new("cameras")
    bpy.context.scene.collection.children.link(collection)
    for record in records:
        width, height = record["width"], record["height"]
        camera = bpy.data.cameras.new(record["img_name"])
        camera.sensor_fit = "HORIZONTAL"
        camera.sensor_width = SENSOR
        camera.lens = record["fx"] * SENSOR / width
        # In parts of the width; the principal point is measured from the upper left corner. Pixels need not be square.
        camera.shift_x = 0.5 - record.get("cx", width / 2) / width
        camera.shift_y = (record.get("cy", height / 2) - height / 2) / width * record["fx"] / record["fy"]
        camera.display_size = 0.1
        thing = bpy.data.objects.new(record["img_name"], camera)
        # Columns: right, down, ahead; Blender's cameras look along -z and have y up.
        axes = Matrix(record["rotation"]) @ Matrix.Diagonal((1, -1, -1))
        thing.matrix_world = Matrix.Translation(np.array(record["position"]) - origin) @ axes.to_4x4()
        collection.objects.link(thing)
        made[record["img_name"]] = thing
        photo = photos / record["img_name"] if photos else None
        if photo and photo.is_file():
            behind = camera.background_images.new()
            # A name from here would not hold in a saved file.
            behind.image = bpy.data.images.load(str(photo.resolve()), check_existing=True)
            camera.show_background_images = True
    return made


def material():
    """Emission in the colour of a Gaussian, as opaque as the Gaussian is along the ray; the far side is not seen."""
    made = bpy.data.materials.new("gaussian")
    if bpy.app.version < (5, 0):
        made.use_nodes = True
    nodes, links = made.node_tree.nodes, made.node_tree.links
    nodes.clear()

    def node(kind, **settings):
        new = nodes.new(kind)
        for name, value in settings.items():
            setattr(new, name, value)
        return new

    def math_node(operation, first, second):
        new = node("ShaderNodeMath", operation=operation)
        for socket, value in zip(new.inputs, (first, second)):
            if isinstance(value, (int, float)):
                socket.default_value = value
            else:
                links.new(value, socket)
        return new.outputs[0]

    def unit(vector):
        new = node("ShaderNodeVectorMath", operation="NORMALIZE")
        links.new(vector, new.inputs[0])
        return new.outputs[0]

    color = node("ShaderNodeAttribute", attribute_type="INSTANCER", attribute_name="color")
    opacity = node("ShaderNodeAttribute", attribute_type="INSTANCER", attribute_name="opacity")
    geometry = node("ShaderNodeNewGeometry")
    ray = node("ShaderNodeVectorTransform", vector_type="VECTOR", convert_from="WORLD", convert_to="OBJECT")
    links.new(geometry.outputs["Incoming"], ray.inputs[0])
    place = node("ShaderNodeTexCoord").outputs["Object"]
    cosine = node("ShaderNodeVectorMath", operation="DOT_PRODUCT")
    links.new(unit(place), cosine.inputs[0])
    links.new(unit(ray.outputs[0]), cosine.inputs[1])
    # Squared distance of ray and centre in standard deviations.
    distance = math_node("MULTIPLY", SIGMAS**2, math_node("SUBTRACT", 1.0, math_node("POWER", cosine.outputs["Value"], 2.0)))
    falloff = math_node("EXPONENT", math_node("MULTIPLY", -0.5, distance), 0.0)
    alpha = math_node("MULTIPLY", opacity.outputs["Fac"], falloff)
    front = math_node("MULTIPLY", alpha, math_node("SUBTRACT", 1.0, geometry.outputs["Backfacing"]))
    emission = node("ShaderNodeEmission")
    links.new(color.outputs["Color"], emission.inputs["Color"])
    mix = node("ShaderNodeMixShader")
    links.new(front, mix.inputs[0])
    links.new(node("ShaderNodeBsdfTransparent").outputs[0], mix.inputs[1])
    links.new(emission.outputs[0], mix.inputs[2])
    links.new(mix.outputs[0], node("ShaderNodeOutputMaterial").inputs["Surface"])
    return made


def ellipsoids():
    """Geometry nodes that show a ball at each point, turned and scaled by the point's attributes."""
    group = bpy.data.node_groups.new("Gaussians", "GeometryNodeTree")
    group.interface.new_socket("Geometry", in_out="INPUT", socket_type="NodeSocketGeometry")
    group.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    nodes, links = group.nodes, group.links

    def attribute(name, kind):
        new = nodes.new("GeometryNodeInputNamedAttribute")
        new.data_type = kind
        new.inputs["Name"].default_value = name
        return new.outputs["Attribute"]

    ball = nodes.new("GeometryNodeMeshIcoSphere")
    ball.inputs["Radius"].default_value = 1.0
    ball.inputs["Subdivisions"].default_value = 2
    painted = nodes.new("GeometryNodeSetMaterial")
    painted.inputs["Material"].default_value = material()
    links.new(ball.outputs["Mesh"], painted.inputs["Geometry"])
    points = nodes.new("GeometryNodeMeshToPoints")
    links.new(nodes.new("NodeGroupInput").outputs[0], points.inputs["Mesh"])
    instances = nodes.new("GeometryNodeInstanceOnPoints")
    links.new(points.outputs["Points"], instances.inputs["Points"])
    links.new(painted.outputs["Geometry"], instances.inputs["Instance"])
    links.new(attribute("rotation", "QUATERNION"), instances.inputs["Rotation"])
    links.new(attribute("scale", "FLOAT_VECTOR"), instances.inputs["Scale"])
    links.new(instances.outputs["Instances"], nodes.new("NodeGroupOutput").inputs[0])
    return group


def add_gaussians(path, most, origin):
    """Points with the Gaussians' attributes; of more than `most` those that cover most."""
    columns, offset = read_gaussians(path)
    stack = lambda *names: np.stack([columns[name] for name in names], axis=1).astype(np.float64)
    opacity = 1.0 / (1.0 + np.exp(-columns["opacity"].astype(np.float64)))
    scale = np.exp(stack("scale_0", "scale_1", "scale_2"))
    two_largest = np.sort(scale, axis=1)[:, 1:].prod(axis=1)
    kept = np.flatnonzero(opacity >= LEAST_OPACITY)
    kept = kept[np.argsort(-(opacity * two_largest)[kept], kind="stable")[:most]]
    rotation = stack("rot_0", "rot_1", "rot_2", "rot_3")[kept]
    rotation /= np.linalg.norm(rotation, axis=1, keepdims=True)
    color = linear(0.5 + SH_DEGREE_0 * stack("f_dc_0", "f_dc_1", "f_dc_2")[kept])
    mesh = bpy.data.meshes.new("gaussians")
    mesh.vertices.add(len(kept))
    mesh.vertices.foreach_set("co", (stack("x", "y", "z")[kept] + (offset - origin)).ravel())
    for name, kind, field, values in [
        ("rotation", "QUATERNION", "value", rotation),
        ("scale", "FLOAT_VECTOR", "vector", SIGMAS * scale[kept]),
        ("color", "FLOAT_COLOR", "color", np.column_stack([color, np.ones(len(kept))])),
        ("opacity", "FLOAT", "value", opacity[kept]),
    ]:
        mesh.attributes.new(name, kind, "POINT").data.foreach_set(field, values.astype(np.float32).ravel())
    thing = bpy.data.objects.new("gaussians", mesh)
    thing.modifiers.new("ellipsoids", "NODES").node_group = ellipsoids()
    bpy.context.scene.collection.objects.link(thing)
    return len(kept), len(opacity)


def set_scene(record, camera, samples):
    """The view's camera and size, and what Cycles needs to see through many Gaussians."""
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.device = "CPU"
    scene.cycles.samples = samples
    scene.cycles.use_denoising = False
    scene.cycles.transparent_max_bounces = 1024
    scene.view_settings.view_transform = "Standard"
    scene.render.resolution_x, scene.render.resolution_y = record["width"], record["height"]
    scene.render.resolution_percentage = 100
    # Blender takes no aspect under 1.
    aspect = record["fx"] / record["fy"]
    scene.render.pixel_aspect_x, scene.render.pixel_aspect_y = max(1 / aspect, 1), max(aspect, 1)
    scene.camera = camera
    world = bpy.data.worlds.new("black")
    world.color = (0, 0, 0)
    scene.world = world


def main(arguments):
    parser = argparse.ArgumentParser(prog="blender_import.py", description=__doc__.split("\n")[0])
    parser.add_argument("model", type=pathlib.Path, help="folder that `ibgs train` wrote")
    parser.add_argument("--photos", type=pathlib.Path, help="folder of the photos, which stand behind their cameras")
    parser.add_argument("--most", type=int, default=500_000, help="most Gaussians to show (default: %(default)s)")
    parser.add_argument("--render", metavar="VIEW", help="render this view, by the name of its photo")
    parser.add_argument("--output", type=pathlib.Path, default="view.png", help="picture to write (default: %(default)s)")
    parser.add_argument("--samples", type=int, default=32, help="samples of a pixel (default: %(default)s)")
    parser.add_argument("--save", type=pathlib.Path, help="also save the scene as this .blend file")
    args = parser.parse_args(arguments)

    clouds = list(args.model.glob("point_cloud/iteration_*/point_cloud.ply"))
    cameras = args.model / "cameras.json"
    if not clouds or not cameras.is_file():
        sys.exit(f"{args.model}: no folder that `ibgs train` wrote; cameras.json or point_cloud/ is missing")
    records = json.loads(cameras.read_text())
    if not records:
        sys.exit(f"{cameras}: has no cameras")
    bpy.ops.wm.read_factory_settings(use_empty=True)
    # Blender computes in float32: scenes far from the origin are brought near to it.
    places = np.array([record["position"] for record in records])
    extent = max(np.ptp(places, axis=0).max(), 1e-9)
    origin = np.round(places.mean(axis=0)) if np.abs(places).max() > 1e3 * extent else np.zeros(3)
    things = add_cameras(records, args.photos, origin)
    cloud = max(clouds, key=lambda path: int(path.parent.name.rsplit("_", 1)[1]))
    count, there = add_gaussians(cloud, args.most, origin)
    print(f"{len(records)} cameras, {count} of {there} Gaussians")
    if origin.any():
        print("moved by", *(f"{-value:.0f}" for value in origin))
    views = {record["img_name"]: record for record in records}
    if args.render and args.render not in views:
        sys.exit(f"{args.model}: no view `{args.render}`; they are named like `{records[0]['img_name']}`")
    shown = views[args.render] if args.render else records[0]
    set_scene(shown, things[shown["img_name"]], args.samples)
    if args.save:
        bpy.ops.wm.save_as_mainfile(filepath=str(args.save.resolve()))
    if args.render:
        bpy.context.scene.render.filepath = str(args.output.resolve())
        bpy.ops.render.render(write_still=True)
        print(f"{args.output} written")


# After `--` where Blender itself runs the script.
main(sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else sys.argv[1:])
