"""Triangles to pictures: Panda3D's software pipe, fed with vertices in the camera's frame.

The camera stands still at the origin of Panda3D's scene; whoever calls moves the vertices. So each vertex can be placed
where the camera saw it at the time of its own row (rolling shutter), which no fixed camera transform can express.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from panda3d.core import (
    Camera,
    FrameBufferProperties,
    Geom,
    GeomNode,
    GeomTriangles,
    GeomVertexArrayData,
    GeomVertexArrayFormat,
    GeomVertexData,
    GeomVertexFormat,
    GraphicsEngine,
    GraphicsOutput,
    GraphicsPipe,
    GraphicsPipeSelection,
    InternalName,
    NodePath,
    OmniBoundingVolume,
    PerspectiveLens,
    SamplerState,
    Texture,
    TransparencyAttrib,
    WindowProperties,
    load_prc_file_data,
)

from mission.errors import VideoError
from mission.records import Image, Vector

NEAR_M = 0.15
FAR_M = 600.0


@dataclass(frozen=True, slots=True, eq=False)
class TriangleBatch:
    """Triangles that share a texture."""

    vertices: Vector
    """(V, 3), world (ENU), metres; for what moves, any placeholder of the right length."""
    triangles: NDArray[np.int32]
    """(T, 3), seen from both sides."""
    uv: Vector
    """(V, 2), in repeats of the texture."""
    colour: NDArray[np.uint8]
    """(V, 4), red, green, blue, alpha: multiplied with the texture."""
    texture: Image
    """BGR, or (h, w): alpha, rows from v = 0 on; the sides are powers of two."""
    sky: bool = False
    """Whether the vertices keep their places relative to the camera (infinitely far)."""
    transparent: bool = False


class Rasterizer:
    """Draws batches into a pinhole picture of a given size and focal length."""

    def __init__(self, width_px: int, height_px: int, focal_px: float, centre_px: tuple[float, float]) -> None:
        """Open an off-screen buffer.

        Args:
            width_px: of the picture.
            height_px: of the picture.
            focal_px: focal length, both ways.
            centre_px: principal point, from the outer corner of the top left pixel.

        Raises:
            VideoError: Panda3D has no software renderer here.
        """
        self.width_px, self.height_px, self.focal_px, self.centre_px = width_px, height_px, focal_px, centre_px
        self._engine, self._buffer, self._picture = _open(width_px, height_px)
        self._root = NodePath("scene")
        lens = PerspectiveLens()
        # The pipe's viewport is half a pixel smaller than its buffer each way (TinyGL), and counts rows from the bottom
        # of the picture that comes out, because the scene is mirrored top to bottom (see `place`) so that pictures are
        # upright without a copy. Panda3D's film is measured from its middle.
        lens.set_film_size(width_px - 0.5, height_px - 0.5)
        lens.set_focal_length(focal_px)
        lens.set_near_far(NEAR_M, FAR_M)
        lens.set_film_offset((width_px - 0.5) / 2.0 - centre_px[0], (height_px + 0.5) / 2.0 - centre_px[1])
        self._region = self._buffer.make_display_region()
        self._region.set_camera(self._root.attach_new_node(Camera("camera", lens)))
        self._nodes: list[GeomNode] = []
        self._paths: list[NodePath] = []

    def add(self, batch: TriangleBatch) -> int:
        """Put a batch into the scene; answers its number for `place`."""
        node = _node(batch)
        path = self._root.attach_new_node(node)
        path.set_texture(_texture(batch.texture))
        path.set_two_sided(True)
        if batch.transparent:
            path.set_transparency(TransparencyAttrib.M_alpha)
            path.set_bin("fixed", 10)
        self._nodes.append(node)
        self._paths.append(path)
        return len(self._nodes) - 1

    def place(self, number: int, camera_points: NDArray[np.float32]) -> None:
        """Say where a batch's vertices are: (V, 3), camera frame (x right, y down, z out), metres."""
        # Panda3D: x right, y ahead, z up; here z down, which mirrors the scene.
        panda = np.ascontiguousarray(camera_points[:, (0, 2, 1)])
        _fill(self._nodes[number].modify_geom(0).modify_vertex_data().modify_array(0), panda)

    def show(self, number: int, visible: bool) -> None:
        """Draw a batch from now on, or leave it out."""
        if visible:
            self._paths[number].show()
        else:
            self._paths[number].hide()

    def paint(self, number: int, colour: NDArray[np.uint8]) -> None:
        """Change a batch's vertex colours: (V, 4), red, green, blue, alpha."""
        _fill(self._nodes[number].modify_geom(0).modify_vertex_data().modify_array(2), colour)

    def cover(self, number: int, alpha: Image) -> None:
        """Change the texture of a batch that was added with one of alpha: (h, w), as large."""
        texture = self._paths[number].get_texture()
        np.frombuffer(memoryview(texture.modify_ram_image()).cast("B"), np.uint8)[:] = alpha.ravel()

    def draw(self) -> Image:
        """Render: (height, width, 4), BGRA, upright; valid until the next call."""
        self._engine.render_frame()
        raw = np.frombuffer(self._picture.get_ram_image(), np.uint8)
        return raw.reshape(self.height_px, self.width_px, 4)

    def close(self) -> None:
        """Give the buffer and the textures back; nothing can be drawn afterwards."""
        # Panda3D keeps a texture for as long as the pipe, which is the process's, unless it is told.
        for path in self._paths:
            texture = path.get_texture()
            if texture is not None:
                texture.release_all()
                texture.clear_ram_image()
            path.remove_node()
        self._engine.remove_all_windows()


def _open(width_px: int, height_px: int) -> tuple[GraphicsEngine, GraphicsOutput, Texture]:
    load_prc_file_data(
        "", "load-display p3tinydisplay\nwindow-type offscreen\naudio-library-name null\nnotify-level-display error\n"
    )
    pipe = GraphicsPipeSelection.get_global_ptr().make_pipe("TinyOffscreenGraphicsPipe")
    if pipe is None:
        raise VideoError("Panda3D's software renderer (p3tinydisplay) is missing", 'pip install "sidestep[sitl]"')
    engine = GraphicsEngine(pipe)
    properties = FrameBufferProperties()
    properties.set_rgba_bits(8, 8, 8, 8)
    properties.set_depth_bits(24)
    size = WindowProperties.size(width_px, height_px)
    buffer = engine.make_output(pipe, "camera", 0, properties, size, GraphicsPipe.BF_refuse_window)
    if buffer is None:
        raise VideoError("Panda3D cannot open an off-screen buffer", "install libX11 and check the size of the picture")
    picture = Texture("picture")
    buffer.add_render_texture(picture, GraphicsOutput.RTM_copy_ram)
    return engine, buffer, picture


def _node(batch: TriangleBatch) -> GeomNode:
    count = len(batch.vertices)
    data = GeomVertexData("batch", _format(), Geom.UH_dynamic)
    data.unclean_set_num_rows(count)
    _fill(data.modify_array(1), batch.uv.astype(np.float32))
    _fill(data.modify_array(2), batch.colour)
    primitive = GeomTriangles(Geom.UH_static)
    primitive.set_index_type(Geom.NT_uint32)
    indices = primitive.modify_vertices()
    indices.unclean_set_num_rows(batch.triangles.size)
    _fill(indices, batch.triangles.astype(np.uint32))
    geom = Geom(data)
    geom.add_primitive(primitive)
    node = GeomNode("batch")
    node.add_geom(geom)
    # The vertices move behind Panda3D's back, so it must never cull by an old bounding volume.
    node.set_bounds(OmniBoundingVolume())
    node.set_final(True)
    return node


def _fill(array: GeomVertexArrayData, values: NDArray[np.generic]) -> None:
    """Copy values into one of Panda3D's arrays, which has the same length in bytes."""
    np.frombuffer(memoryview(array).cast("B"), np.uint8)[:] = np.ascontiguousarray(values).view(np.uint8).ravel()


def _format() -> GeomVertexFormat:
    place, texture, colour = GeomVertexArrayFormat(), GeomVertexArrayFormat(), GeomVertexArrayFormat()
    place.add_column(InternalName.get_vertex(), 3, Geom.NT_float32, Geom.C_point)
    texture.add_column(InternalName.get_texcoord(), 2, Geom.NT_float32, Geom.C_texcoord)
    colour.add_column(InternalName.get_color(), 4, Geom.NT_uint8, Geom.C_color)
    together = GeomVertexFormat()
    for array in (place, texture, colour):
        together.add_array(array)
    return GeomVertexFormat.register_format(together)


def _texture(picture: Image) -> Texture:
    texture = Texture("surface")
    colours = picture.ndim == 3
    form = Texture.F_rgb if colours else Texture.F_alpha
    texture.setup_2d_texture(picture.shape[1], picture.shape[0], Texture.T_unsigned_byte, form)
    texture.set_ram_image(np.ascontiguousarray(picture[::-1] if colours else picture).tobytes())
    wrap = SamplerState.WM_repeat if colours else SamplerState.WM_clamp
    texture.set_wrap_u(wrap)
    texture.set_wrap_v(wrap)
    texture.set_minfilter(SamplerState.FT_linear_mipmap_nearest if colours else SamplerState.FT_linear)
    texture.set_magfilter(SamplerState.FT_linear)
    return texture
