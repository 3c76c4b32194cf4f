import sys,re,math
exec(open('gain.py').read().split("C=0.25")[0].split("order=[]")[0])
f,key,n=sys.argv[1],sys.argv[2],int(sys.argv[3])
src=open('gain.py').read()
g={}
exec('import re,math\n'+src[src.index('def geo'):src.index('C=0.25')],g)
Y=None;true=None;first=None;idx=-1;cells={};cur=None;post=None;searches=[]
for l in open(f):
    w=l.split()
    if not w or len(w)<2 or not w[1].endswith(key): continue
    if w[0]=='Y': Y=l
    elif w[0]=='P': true=tuple(map(float,w[3:6]))
    elif w[0]=='E' and w[3]=='Log':
        if ' B ' in l:
            i=w.index('B');b=tuple(map(float,w[i+1:i+4]))
            if first is None: first=(true,b)
            idx+=1;searches.append((b,true))
            if idx==n: post=(true,b)
            if idx>n: break
        elif w[-1]=='MB': cur=idx
        elif ' M ' in l and cur==n:
            for c in w[w.index('M')+1:]:
                a=c.split(',');cells[(int(a[0]),int(a[1]))]=(int(a[2])/10,a[3]=='1')
W,D,segs,st=g['geo'](Y)
# true -> script frame, aligned at post (believed pose now)
(tx,ty,th),(bx,by,bh)=post
r=bh-th
def tr(x,y):
    dx,dy=x-tx,y-ty
    return bx+math.cos(r)*dx-math.sin(r)*dy, by+math.sin(r)*dx+math.cos(r)*dy
C=.15
grid={}
for (x,y),(v,s) in cells.items():
    grid[(x,y)]='#' if v>.2 else (',' if s else 'o') if v<-.2 else '?'
def put(x,y,ch):
    grid[(math.floor(x/C),math.floor(y/C))]=ch
for x1,y1,x2,y2 in segs:
    L=math.hypot(x2-x1,y2-y1)
    for i in range(int(L/.07)+1):
        t=i*.07/L if L else 0
        X,Yy=tr(x1+t*(x2-x1),y1+t*(y2-y1))
        k=(math.floor(X/C),math.floor(Yy/C))
        grid[k]='W' if grid.get(k,' ') in '#W' else 'x' if grid.get(k,' ') in ',o' else 'w'
for m in re.finditer(r'at: Spot\(\[Coordinate\(([-\d.]+)\), Coordinate\(([-\d.]+)\)\]\)[^}]*?length: ([\d.]+), width: ([\d.]+)[^}]*?heading_degrees: ([-\d.]+)',Y.split(' || ')[2]):
    cx,cy,le,wi,hd=map(float,m.groups());a=math.radians(hd)
    for i in range(-20,21):
        for j in range(-20,21):
            px,py=i/40*le,j/40*wi
            if abs(i)==20 or abs(j)==20:
                X,Yy=tr(cx+math.cos(a)*px-math.sin(a)*py,cy+math.sin(a)*px+math.cos(a)*py)
                k=(math.floor(X/C),math.floor(Yy/C))
                grid[k]='F' if grid.get(k,' ') in '#FW' else 'f'
for k,(b,t) in enumerate(searches[:n+1]): put(b[0],b[1],chr(65+k) if k<22 else '*')
X,Yy=tr(*st);put(X,Yy,'S')
xs=[k[0] for k in grid];ys=[k[1] for k in grid]
for y in range(max(ys),min(ys)-1,-1):
    print(''.join(grid.get((x,y),' ') for x in range(min(xs),max(xs)+1)))
