"""Lampglow's glow beside Blender's Cycles, a path tracer that nobody here wrote. Run by hand; not a test.

Cycles (Debian: apt install --no-install-recommends blender; 3.4.1 was used) renders a point lamp in a ball of
fog: unidirectional paths with next-event estimation, equiangular and distance sampling of the volume,
Henyey-Greenstein, albedo 1. A camera at optical distance T looks at the lamp; the profile in rings is
compared with `lampglow glow --model monte_carlo` in the same ball and with `--model table`, whose medium is
infinite and brighter by a closed form (docs/scattering.md). Absolute: the lamp's watts are the only scale, and
a white disc in clear air shows that Cycles' watts are physics' (E = P / 4 pi d^2, L = E / pi).

    blender --background --factory-startup --python tests/bench/scattering/cycles_peer.py -- LAMPGLOW [OPTIONS]

Prints CSV on standard output and a summary: deviations, paths and photons per second of processor time on one
thread, and the time that either needs to know the middle ring of nine to one per cent.

The pixels' spread understates Cycles' error: a path that is scattered towards the lamp and passes it at distance b
brings light as 1/b, whose variance has no bound as the lamp shrinks; Cycles does not aim its turns at the lamp.
"""

import argparse
import math
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time

import bpy
import numpy

LAMP_RADIUS = 1e-4  # mean free paths
PIXELS = 128  # a side
# Three pictures of these half widths [deg], and their rings: each is many pixels across, so that a pixel's
# middle stands for the pixel.
PICTURES = {1.0: (0.2, 0.4, 0.8), 5.5: (1.5, 2.8, 5.0), 32.0: (8.0, 15.0, 30.0)}
RING = 0.03  # half a ring's width over its angle, as in `lampglow glow`
WATT = 1.0


def arguments():
    own = sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else []
    parser = argparse.ArgumentParser(prog="cycles_peer.py", description=__doc__.splitlines()[0])
    parser.add_argument("lampglow")
    parser.add_argument("--thickness", type=float, nargs="+", default=[0.5, 1.2, 3.0])
    parser.add_argument("--q", type=float, nargs="+", default=[0.2, 0.75, 0.9])
    parser.add_argument("--radius", type=float, default=25.0, help="of the ball, in mean free paths")
    parser.add_argument("--samples", type=int, default=32, help="paths per pixel")
    parser.add_argument("--photons", type=int, default=4_000_000)
    parser.add_argument("--seed", type=int, default=1)
    return parser.parse_args(own)


def empty_scene(options):
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.render.threads_mode = "FIXED"
    scene.render.threads = 1
    scene.render.resolution_x = scene.render.resolution_y = PIXELS
    scene.render.resolution_percentage = 100
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.render.image_settings.color_depth = "32"
    scene.render.image_settings.exr_codec = "NONE"
    cycles = scene.cycles
    cycles.device = "CPU"
    cycles.samples = options.samples
    cycles.seed = options.seed
    cycles.use_adaptive_sampling = False
    cycles.use_denoising = False
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = 0
    cycles.light_sampling_threshold = 0
    cycles.max_bounces = cycles.volume_bounces = 1024
    cycles.diffuse_bounces = cycles.transparent_max_bounces = 8
    cycles.blur_glossy = 0
    cycles.pixel_filter_type = "BOX"
    cycles.filter_width = 1
    world = bpy.data.worlds.new("dark")
    world.use_nodes = True
    world.node_tree.nodes["Background"].inputs["Strength"].default_value = 0
    scene.world = world
    return scene


def add_lamp(scene):
    light = bpy.data.lights.new("lamp", "POINT")
    light.energy = WATT
    light.shadow_soft_size = LAMP_RADIUS
    light.cycles.max_bounces = 1024
    # So small a lamp is never hit by chance; next-event estimation alone brings its light.
    light.cycles.use_multiple_importance_sampling = False
    scene.collection.objects.link(bpy.data.objects.new("lamp", light))


def add_fog(scene, q, radius):
    material = bpy.data.materials.new("fog")
    material.use_nodes = True
    nodes, links = material.node_tree.nodes, material.node_tree.links
    nodes.clear()
    scatter = nodes.new("ShaderNodeVolumeScatter")
    scatter.inputs["Color"].default_value = (1, 1, 1, 1)
    scatter.inputs["Density"].default_value = 1
    scatter.inputs["Anisotropy"].default_value = q
    output = nodes.new("ShaderNodeOutputMaterial")
    links.new(scatter.outputs["Volume"], output.inputs["Volume"])
    material.cycles.homogeneous_volume = True
    material.cycles.volume_sampling = "MULTIPLE_IMPORTANCE"
    bpy.ops.mesh.primitive_uv_sphere_add(segments=128, ring_count=64, radius=radius)
    bpy.context.object.data.materials.append(material)


def add_camera(scene, distance):
    camera = bpy.data.cameras.new("camera")
    camera.clip_start, camera.clip_end = 1e-5, 1e5
    eye = bpy.data.objects.new("camera", camera)
    eye.location = (0, 0, distance)  # looks along -z, at the lamp
    scene.collection.objects.link(eye)
    scene.camera = eye
    return camera


def render(scene):
    """The red channel [rows][columns] and the processor seconds it took."""
    path = os.path.join(tempfile.gettempdir(), f"cycles_peer_{os.getpid()}.exr")
    scene.render.filepath = path
    begin = time.process_time()
    bpy.ops.render.render(write_still=True)
    seconds = time.process_time() - begin
    picture = bpy.data.images.load(path)
    picture.colorspace_settings.name = "Non-Color"
    values = numpy.empty(PIXELS * PIXELS * 4, dtype=numpy.float32)
    picture.pixels.foreach_get(values)
    bpy.data.images.remove(picture)
    os.remove(path)
    return values.reshape(PIXELS, PIXELS, 4)[:, :, 0].astype(float), seconds


def watt_of_cycles(options):
    """Radiance of a white disc in clear air over P / (4 pi^2 d^2): 1 if Cycles' watt is a watt."""
    scene = empty_scene(options)
    add_lamp(scene)
    distance = 3.0
    material = bpy.data.materials.new("white")
    material.use_nodes = True
    nodes, links = material.node_tree.nodes, material.node_tree.links
    nodes.clear()
    diffuse = nodes.new("ShaderNodeBsdfDiffuse")
    diffuse.inputs["Color"].default_value = (1, 1, 1, 1)
    links.new(diffuse.outputs["BSDF"], nodes.new("ShaderNodeOutputMaterial").inputs["Surface"])
    bpy.ops.mesh.primitive_plane_add(size=0.02, location=(0, 0, -distance))
    bpy.context.object.data.materials.append(material)
    camera = add_camera(scene, -distance + 1)
    camera.angle = math.radians(0.4)
    scene.cycles.max_bounces = 0
    middle = slice(PIXELS // 4, 3 * PIXELS // 4)
    picture, _ = render(scene)
    return picture[middle, middle].mean() * 4 * math.pi**2 * distance**2 / WATT


def pixel_angles(half_width_deg):
    """Angle from the lamp [deg] of every pixel's middle."""
    across = (numpy.arange(PIXELS) + 0.5) / PIXELS * 2 - 1
    tangent = numpy.hypot(across[:, None], across[None, :]) * math.tan(math.radians(half_width_deg))
    return numpy.degrees(numpy.arctan(tangent))


def glow(options, model, q, thickness, angles, *more):
    """Rows of `lampglow glow`: (total, standard deviation or 0), and the processor seconds."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(
        [options.lampglow, "glow", "--model", model, "--q", str(q), "--thickness", str(thickness),
         "--theta-deg", ",".join(f"{angle:.10g}" for angle in angles), *more],
        check=True, capture_output=True, text=True)  # fmt: skip
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    lines = done.stdout.splitlines()
    totals = [float(line.split(",")[3]) for line in lines if line[:1].isdigit()]
    sigmas = [float(line.split("total ")[1]) for line in lines if "standard deviation" in line]
    return totals, sigmas or [0.0] * len(totals), after.ru_utime - before.ru_utime


def rings_of(picture, half_width, angles, slopes):
    """Mean radiance and its relative error in rings about `angles`, from the pixels' own spread. The profile
    is straightened by its slope d ln L / d ln theta, so that the mean is the value at the ring's angle."""
    theta = pixel_angles(half_width)
    result = []
    for angle, slope in zip(angles, slopes):
        inside = numpy.abs(theta / angle - 1) < RING
        values = picture[inside] * (theta[inside] / angle) ** -slope
        result.append((values.mean(), values.std(ddof=1) / math.sqrt(values.size) / values.mean()))
    return result


def cycles_profile(options, q, thickness, table):
    """{angle: (radiance, relative error)}, processor seconds, number of paths."""
    scene = empty_scene(options)
    add_lamp(scene)
    add_fog(scene, q, options.radius)
    camera = add_camera(scene, thickness)
    rings, seconds, paths = {}, 0.0, 0
    for half_width, angles in PICTURES.items():
        camera.angle = math.radians(2 * half_width)
        picture, spent = render(scene)
        seconds += spent
        paths += picture.size * options.samples
        slopes = [table[angle][1] for angle in angles]
        rings.update(zip(angles, rings_of(picture, half_width, angles, slopes)))
    return rings, seconds, paths


def table_profile(options, q, thickness, angles):
    """{angle: (radiance, d ln L / d ln theta)} of the table."""
    step = 1.01
    around = [angle * factor for angle in angles for factor in (1 / step, 1, step)]
    values, _, _ = glow(options, "table", q, thickness, around)
    return {
        angle: (values[3 * i + 1], math.log(values[3 * i + 2] / values[3 * i]) / (2 * math.log(step)))
        for i, angle in enumerate(angles)
    }


def beyond_the_ball(q, radius):
    """What the infinite medium's glow is brighter by: docs/scattering.md."""
    return 3 * (1 - q) / (16 * math.pi**2 * (radius + 0.7104 / (1 - q)))


def main():
    options = arguments()
    out = os.fdopen(os.dup(1), "w", buffering=1)
    os.dup2(2, 1)  # Blender's own messages go to standard error
    print(f"# Blender {bpy.app.version_string}, ball of {options.radius:g} mean free paths", file=out)
    print(f"# Cycles' watt in clear air: {watt_of_cycles(options):.4f} of physics'", file=out)
    print("q,thickness,theta_deg,cycles,sigma_percent,monte_carlo,sigma_percent,"
          "cycles_over_monte_carlo,cycles_over_table,deviation_in_sigma", file=out)  # fmt: skip
    angles = [angle for group in PICTURES.values() for angle in group]
    deviations, ratios, off_table, speeds = [], [], [], []
    for q in options.q:
        for thickness in options.thickness:
            table = table_profile(options, q, thickness, angles)
            rings, seconds, paths = cycles_profile(options, q, thickness, table)
            ours, sigmas, our_seconds = glow(
                options, "monte_carlo", q, thickness, angles, "--medium-radius", str(options.radius),
                "--photons", str(options.photons), "--threads", "1", "--seed", str(options.seed))  # fmt: skip
            errors, our_errors = [], []
            for angle, value, sigma in zip(angles, ours, sigmas):
                cycles, error = rings[angle][0] / WATT, rings[angle][1]
                in_ball = table[angle][0] - beyond_the_ball(q, options.radius)
                deviation = (cycles / value - 1) / math.hypot(error, sigma / value)
                deviations.append(deviation)
                off_table.append(cycles / in_ball)
                ratios.append(cycles / value)
                errors.append(error)
                our_errors.append(sigma / value)
                print(f"{q:g},{thickness:g},{angle:g},{cycles:.5g},{100 * error:.2f},{value:.5g},"
                      f"{100 * sigma / value:.2f},{cycles / value:.4f},{cycles / in_ball:.4f},"
                      f"{deviation:.2f}", file=out)  # fmt: skip
            middle, our_middle = statistics.median(errors), statistics.median(our_errors)
            speeds.append((q, thickness, paths, seconds, middle, our_seconds, our_middle))
    print("# seconds to 1 %: processor time x (middle ring's error / 1 %)^2", file=out)
    print("q,thickness,cycles_paths,cycles_s,cycles_paths_per_s,cycles_middle_percent,cycles_s_to_1_percent,"
          "photons,photons_s,photons_per_s,middle_percent,s_to_1_percent,ratio", file=out)  # fmt: skip
    for q, thickness, paths, seconds, middle, our_seconds, our_middle in speeds:
        theirs, own = seconds * (100 * middle) ** 2, our_seconds * (100 * our_middle) ** 2
        print(f"{q:g},{thickness:g},{paths},{seconds:.1f},{paths / seconds:.0f},{100 * middle:.2f},{theirs:.1f},"
              f"{options.photons},{our_seconds:.1f},{options.photons / our_seconds:.0f},{100 * our_middle:.2f},"
              f"{own:.1f},{theirs / own:.1f}", file=out)  # fmt: skip
    off = sorted(abs(ratio - 1) for ratio in off_table)
    spread = statistics.stdev(ratios) / math.sqrt(len(ratios)) if len(ratios) > 1 else 0
    print(f"# {len(ratios)} rings: Cycles over our photons {statistics.mean(ratios):.4f} +- {spread:.4f}, over the "
          f"table {statistics.mean(off_table):.4f}, one ring off by {100 * off[len(off) // 2]:.2f} % (median) to "
          f"{100 * off[-1]:.2f} %; mean squared deviation from our photons "
          f"{statistics.mean(d * d for d in deviations):.2f} sigma^2", file=out)  # fmt: skip


main()
