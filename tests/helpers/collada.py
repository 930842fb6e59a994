"""Parts of COLLADA files: one geometry of three vertices, its parts and the nodes that place it."""

COLLADA = """<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1"><asset/>
<library_geometries><geometry id="g"><mesh><source id="p"><float_array id="a" count="9">
0 0 0 1 0 0 0 1 0</float_array><technique_common><accessor source="#a" count="3" stride="3">
<param name="X" type="float"/><param name="Y" type="float"/><param name="Z" type="float"/>
</accessor>
</technique_common></source><vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
{parts}</mesh></geometry></library_geometries><library_visual_scenes><visual_scene id="s">{nodes}
</visual_scene></library_visual_scenes><scene><instance_visual_scene url="#s"/></scene></COLLADA>
"""
TRIANGLES = """<triangles count="{0}"><input semantic="VERTEX" source="#v" offset="0"/><p>{1}</p>
</triangles>"""
POLYGONS = """<polylist count="1"><input semantic="VERTEX" source="#v" offset="0"/>
<vcount>{}</vcount><p>0 1 2</p></polylist>"""
NODE = '<node id="n"><instance_geometry url="#g"/></node>'
