import sys,re,math
Y={};P={};order=[]
for l in open(sys.argv[1]):
    if l[0]=='Y': k=l.split()[1]; Y[k]=l
    elif l[0]=='P':
        f=l.split(); P[f[1]]=[float(x) for x in f[3:7]]
o=open(sys.argv[2],'w');n=0
for k,l in Y.items():
    if k not in P: continue
    parts=l.split(' || ')
    W=float(re.search(r'width: ([\d.]+)',parts[0])[1]);D=float(re.search(r'depth: ([\d.]+)',parts[0])[1])
    segs=[(0,0,W,0),(W,0,W,D),(W,D,0,D),(0,D,0,0)]
    for m in re.finditer(r'from: Spot\(\[Coordinate\(([-\d.]+)\), Coordinate\(([-\d.]+)\)\]\), to: Spot\(\[Coordinate\(([-\d.]+)\), Coordinate\(([-\d.]+)\)\]\), thickness: ([\d.]+)',parts[1]):
        x1,y1,x2,y2,t=map(float,m.groups())
        L=math.hypot(x2-x1,y2-y1)
        if L<1e-6: continue
        nx,ny=-(y2-y1)/L*t/2,(x2-x1)/L*t/2
        Q=[(x1+nx,y1+ny),(x2+nx,y2+ny),(x2-nx,y2-ny),(x1-nx,y1-ny)]
        for i in range(4): segs.append(Q[i]+Q[(i+1)%4])
    for m in re.finditer(r'Furniture \{ at: Spot\(\[Coordinate\(([-\d.]+)\), Coordinate\(([-\d.]+)\)\]\), length: ([\d.]+), width: ([\d.]+), height: ([\d.]+), heading_degrees: ([-\d.]+)',l):
        x,y,L,Wd,H,h=map(float,m.groups());h=math.radians(h);c,s=math.cos(h),math.sin(h)
        Q=[(x+c*a*L/2-s*b*Wd/2,y+s*a*L/2+c*b*Wd/2) for a,b in ((-1,-1),(1,-1),(1,1),(-1,1))]
        for i in range(4): segs.append(Q[i]+Q[(i+1)%4])
    for m in re.finditer(r'Post \{ at: Spot\(\[Coordinate\(([-\d.]+)\), Coordinate\(([-\d.]+)\)\]\), radius: ([\d.]+)',l):
        x,y,r=map(float,m.groups());Q=[(x-r,y-r),(x+r,y-r),(x+r,y+r),(x-r,y+r)]
        for i in range(4): segs.append(Q[i]+Q[(i+1)%4])
    s=re.search(r'Station \{ at: Spot\(\[Coordinate\(([-\d.]+)\), Coordinate\(([-\d.]+)\)\]\), heading_degrees: ([-\d.]+)',l)
    wk=[]
    for m in re.finditer(r'Walker \{.*?radius: ([\d.]+).*?through: \[(.*?)\], speed: ([\d.]+), pause: ([\d.]+)',parts[4]):
        pts=re.findall(r'Coordinate\(([-\d.]+)\), Coordinate\(([-\d.]+)\)',m[2]);wk.append('%s %s %s %d %s'%(m[1],m[3],m[4],len(pts),' '.join(a+' '+b for a,b in pts)))
    o.write('%s %s %s %s %d %d %s\n'%(k,' '.join('%g'%v for v in P[k]),' '.join(s.groups()),'%g %g'%(W,D),len(segs),len(wk),' '.join(wk)))
    for q in segs: o.write('%g %g %g %g\n'%q)
    n+=1
print(n)
