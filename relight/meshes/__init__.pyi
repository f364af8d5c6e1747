from relight.meshes.alignment import align as align
from relight.meshes.cleaning import clean as clean
from relight.meshes.geometry import vertex_normals as vertex_normals
from relight.meshes.mesh import Material as Material
from relight.meshes.mesh import Mesh as Mesh
from relight.meshes.read import read_mesh as read_mesh
from relight.meshes.scans import list_scans as list_scans
