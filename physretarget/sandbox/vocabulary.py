"""Which words of MuJoCo's language a stranger's model may use: those looked at one by one.

MuJoCo learns new elements and attributes with every version, some of which open files. What is
not listed here is refused until somebody has looked at it; a test compares with the schema of
the MuJoCo that is installed (4.0 when this was written).
"""

from __future__ import annotations


def _words(text: str) -> frozenset[str]:
    return frozenset(text.split())


# Load code; read models or meshes with rules of their own; simulate while compiling. Deformable
# bodies (flex, flexcomp, composite) multiply by counts, and are no characters.
REFUSED_ELEMENTS = _words(
    """
    attach composite config extension flex flexcomp flexstrain instance lengthrange model plugin
    """
)

ELEMENTS = _words(
    """
    accelerometer actuator actuatorfrc actuatorpos actuatorvel adhesion asset ballangvel
    ballquat body bone camera camprojection clock compiler connect contact custom cylinder
    damper dcmotor default deformable distance e_kinetic e_potential edge elasticity element
    equality exclude fixed flag force frame frameangacc frameangvel framelinacc framelinvel
    framepos framequat framexaxis frameyaxis framezaxis freejoint fromto general geom global
    gyro headlight hfield include inertial insidesite intvelocity joint jointactuatorfrc
    jointlimitfrc jointlimitpos jointlimitvel jointpos jointvel key keyframe layer light
    magnetometer map material mesh motor mujoco mujocoinclude muscle normal numeric option
    orientation pair pid pin position pulley quality rangefinder replicate rgba scale sensor
    site size skin spatial statistic subtreeangmom subtreecom subtreelinvel tactile tendon
    tendonactuatorfrc tendonlimitfrc tendonlimitpos tendonlimitvel tendonpos tendonvel text
    texture torque touch tuple user velocimeter velocity visual weld worldbody
    """
)

# Name a file each; which folder it is looked for in, and what may be in it, is in assets.py.
FILE_ATTRIBUTES = _words(
    """
    file fileback filedown filefront fileleft fileright fileup
    """
)

# Name a folder each.
FOLDER_ATTRIBUTES = frozenset(("assetdir", "meshdir", "texturedir"))

# Name another element each; where that is replicated, MuJoCo repeats what names it as often.
NAMING_ATTRIBUTES = _words(
    """
    actuator body body1 body2 cranksite geom geom1 geom2 joint joint1 joint2 jointinparent
    objname refname refsite sidesite site site1 site2 slidersite subtree1 subtree2 tendon tendon1
    tendon2
    """
)

ATTRIBUTES = _words(
    """
    accel act actdim actearly active activelayers actlimited actrange actuation actuator
    actuatorfrclimited actuatorfrcrange actuatorgravcomp actuatorgroupdisable actuatorlength
    actuatornegative actuatorpositive actuatortendon actuatorwidth adhesion align alignfree
    alpha ambient anchor angle area armature assetdir attenuation autolimits autoreset axis
    axisangle azimuth balanceinertia bias biasprm biastype bindpos bindquat body body1 body2
    boundinertia boundmass builtin bulbradius bv bvactive camera cameraid castshadow
    ccd_iterations ccd_tolerance cell cellcount center childclass clampctrl class coef cogging
    colorspace com conaffinity condim cone conflict connect constraint contact contactforce
    contactfriction contactgap contactheight contactpoint contacttorque contactwidth
    content_type controller contype coordinate count crankbroken cranklength cranksite ctrl
    ctrllimited ctrlrange cutoff damper damping dampratio data datatype delay density
    diagexact diaginertia diameter diffuse dim dir directional discardvisual divisor dof
    dynprm dyntype elastic2d element elemtexcoord elevation ellipsoidinertia embed emission
    enclosed energy equality euler eulerdamp eulerseq exponent extent face ffrange file
    fileback filedown filefront fileleft fileright fileup filterparent fitaabb fitscale
    flatskin flex fluidcoef fluidshape focal focalpixel fog fogend fogstart force forcelimited
    forcerange forcewidth fovy fpmax frame framelength framewidth friction frictionloss fromto
    frustum fullinertia fuse fusestatic fvmax fwdinv gain gainprm gaintype gap gear geom geom1
    geom2 glow gravcomp gravity grid gridlayout gridrange gridsize group haze height hfield
    hflip id imax impratio inductance inertia inertiabox inertiafromgeom inertiagrouprange
    inflate inheritrange input integrator intensity interp interval inttotal invdiscrete ipc
    ipd island iterations jacobian joint joint1 joint2 jointinparent jointlength jointwidth
    key ki kp kv lengthrange light limit limited linewidth lmax lmin ls_iterations
    ls_tolerance lugre magnetic margin mark markrgb mass massscale material maxforce
    maxhullvert meaninertia meanmass meansize memory mesh meshdir metallic midphase mocap mode
    model motorconst mpos mquat multiccd name nativeccd nchannel ncol nconmax needstage njmax
    nkey node nodecoord noise nominal normal noslip_iterations noslip_tolerance nrow nsample
    nstack num numquads numslices numstacks nuser_actuator nuser_body nuser_cam nuser_geom
    nuser_jnt nuser_sensor nuser_site nuser_tendon nuserdata o_friction o_margin o_solimp
    o_solref objname objtype offheight offsamples offset offwidth origin orthographic output
    override params passive passthrough plastic point poisson polycoef pos posrange prefix
    principal principalpixel priority prm projection qpos quat qvel radius random range
    rangefinder realtime reduce ref reflectance refname refpos refquat refsafe refsite reftype
    relpose resistance resolution rgb1 rgb2 rgba rigid role roughness saturation savecanonical
    savecompiled saveinertial scale scaling sdf_initpoints sdf_iterations section sectionsize
    selectpoint selfcollide sensor sensorsize sep settotalmass shadowclip shadowscale
    shadowsize shear shellinertia shininess sidesite simple site site1 site2 size sleep
    sleep_tolerance slewmax slidercrank slidersite smoothnormal softness solimp solimpfriction
    solimplimit solmix solref solreffriction solreflimit solver spacing specular speculative
    spring springdamper springlength springref springyield stiffness stiffnessrot strippath
    subtree1 subtree2 surfacevel target tausmooth tendon tendon1 tendon2 texcoord texrepeat
    texture texturedir texuniform thermal thickness time timeconst timestep tolerance tolrange
    torque torquescale type useexisting uselimit user usethread value velrange vertex vertid
    vertweight vflip viscosity vmax warmstart width wind xyaxes yield young zaxis zfar znear
    """
)
