"""A robot whose names try to become markup."""

from __future__ import annotations

from html import escape

NAME = "<script>alert(1)</script>"
LINK = '"><img src=x onerror=alert(2)>'
JOINT = "</title></svg></script><iframe src=javascript:alert(3)>"

_INERTIAL = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="9" ixy="0" ixz="0" iyz="0"/></inertial>'
_SHAPE = '<visual><geometry><sphere radius="1"/></geometry></visual>'
HOSTILE = f"""<robot name="{escape(NAME)}"><link name="base">{_SHAPE}</link>
<link name="{escape(LINK)}">{_INERTIAL}</link><link name="{escape(NAME)}">{_INERTIAL}</link>
<joint name="{escape(JOINT)}" type="continuous"><parent link="base"/><child link="{escape(LINK)}"/>
<origin rpy="1.5708 0 0"/><axis xyz="0 0 1"/></joint>
<joint name="{escape(LINK)}" type="continuous"><parent link="{escape(LINK)}"/><child link="{escape(NAME)}"/>
<origin xyz="0.3 0 0.1"/><axis xyz="0 1 0"/></joint></robot>
"""
"""A URDF with an impossible inertia, a missing one, and a rounded angle."""
